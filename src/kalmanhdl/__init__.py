"""kalmanhdl: a Kalman filter, written once as a model, becomes verified FPGA hardware.

    from kalmanhdl import Design

    design = Design.load("designs/lee1997.toml")
    simulation = design.simulate(z)
    record = design.build("build/lee1997")

Nothing is imported before it is used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kalmanhdl.arithmetic.fixed import Fixed as Fixed
    from kalmanhdl.design import Architecture as Architecture
    from kalmanhdl.design import Design as Design
    from kalmanhdl.design import Target as Target
    from kalmanhdl.errors import KalmanhdlError as KalmanhdlError
    from kalmanhdl.model.convert import from_filterpy as from_filterpy
    from kalmanhdl.model.convert import from_state_space as from_state_space
    from kalmanhdl.model.initial import given as given
    from kalmanhdl.model.initial import two_point as two_point
    from kalmanhdl.model.motion import constant_acceleration as constant_acceleration
    from kalmanhdl.model.motion import constant_velocity as constant_velocity
    from kalmanhdl.model.state_space import LinearModel as LinearModel
    from kalmanhdl.model.state_space import linear_model as linear_model
    from kalmanhdl.numerics.floating import FloatSpecification as FloatSpecification
    from kalmanhdl.numerics.specification import FixedSpecification as FixedSpecification

__version__ = "0.1.0"

_HOMES = {
    "Architecture": "design",
    "Design": "design",
    "Fixed": "arithmetic.fixed",
    "FixedSpecification": "numerics.specification",
    "FloatSpecification": "numerics.floating",
    "KalmanhdlError": "errors",
    "LinearModel": "model.state_space",
    "Target": "design",
    "constant_acceleration": "model.motion",
    "constant_velocity": "model.motion",
    "from_filterpy": "model.convert",
    "from_state_space": "model.convert",
    "given": "model.initial",
    "linear_model": "model.state_space",
    "two_point": "model.initial",
}

__all__ = [*_HOMES, "__version__"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'kalmanhdl' has no attribute {name!r}")
    return getattr(import_module(f"kalmanhdl.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
