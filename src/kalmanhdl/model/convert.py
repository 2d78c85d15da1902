"""Models of other libraries, taken over in one call. None of them is imported: their attributes are read."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.errors import ModelError
from kalmanhdl.model.checks import reals
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import Initial, InitialRule, LinearModel, linear_model
from kalmanhdl.validation import as_real, names_problem, shown

Array = NDArray[np.float64]

_FILTERPY = ("F", "H", "Q", "R", "x", "P")
_DISCRETISE = "discretise it first (scipy.signal.cont2discrete, or control.sample_system)"


def from_filterpy(
    kf: Any,
    *,
    state_names: Sequence[str] | None = None,
    state_units: Sequence[str] | None = None,
    measurement_names: Sequence[str] | None = None,
    control_names: Sequence[str] | None = None,
) -> LinearModel:
    """The model of a ``filterpy.kalman.KalmanFilter``, with its x and P as they stand.

    filterpy predicts before it updates, so x and P are the belief one step before the first row; that
    first prediction is taken without a control. A row's control is the ``u`` of the ``predict`` before
    its ``update``.

    Raises:
        ModelError: an attribute is missing or no valid part of a model, or the filter fades its memory
            (``alpha``) or has a process noise correlated with the measurements' (``M``).
    """
    missing = [name for name in _FILTERPY if getattr(kf, name, None) is None]
    if missing:
        raise ModelError(
            f"{_called(kf)} has no {', '.join(missing)}: pass a filterpy.kalman.KalmanFilter, or give its "
            "matrices to linear_model"
        )
    parts = {name: getattr(kf, name) for name in _FILTERPY}
    if as_real(getattr(kf, "alpha", 1.0)) != 1.0:
        raise ModelError(f"the filterpy filter fades its memory (alpha = {shown(kf.alpha)}): set alpha to 1")
    if _numbers(kf, "M").any():
        raise ModelError("the filterpy filter has correlated noises (M is not 0): set M to 0")
    B = _numbers(kf, "B")
    return linear_model(
        parts["F"],
        parts["H"],
        parts["Q"],
        parts["R"],
        B=B if B.ndim == 2 and B.any() else None,
        initial=given(_numbers(kf, "x").ravel(), parts["P"], at="before_first"),
        state_names=state_names,
        state_units=state_units,
        measurement_names=measurement_names,
        control_names=control_names,
    )


def from_state_space(
    system: Any,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    initial: Initial | InitialRule,
    state_names: Sequence[str] | None = None,
    state_units: Sequence[str] | None = None,
    measurement_names: Sequence[str] | None = None,
    control_names: Sequence[str] | None = None,
) -> LinearModel:
    """The model of a discrete ``scipy.signal`` or ``control`` system under noises Q (n, n) and R (m, m).

    Takes A, B and C; a scipy transfer function is realised by its own ``to_ss``. Those libraries write
    x[k+1] = A x[k] + B u[k]; here the control of row k is the one that leads to row k, their u[k-1].
    The names of a ``control`` system are taken over where they are valid names.

    Raises:
        ModelError: the system is continuous, feeds controls through to the measurements (D), has no
            state space, or the model is not valid.
    """
    if not hasattr(system, "dt"):
        raise ModelError(
            f"{_called(system)} is no state-space system: pass one of scipy.signal (dlti) or control (ss), "
            "or give its matrices to linear_model"
        )
    if _is_continuous(system):
        raise ModelError(f"the system is continuous in time: {_DISCRETISE}")
    if not hasattr(system, "A") and callable(getattr(system, "to_ss", None)):
        system = system.to_ss()
    A, C = (_attribute(system, name, "state-space system") for name in "AC")
    if _numbers(system, "D").any():
        raise ModelError(
            "the system feeds controls through to its outputs (D is not 0): take them off before"
        )
    _attribute(system, "B", "state-space system")
    B = _numbers(system, "B")
    return linear_model(
        A,
        C,
        Q,
        R,
        B=B if B.any() else None,
        initial=initial,
        state_names=_labels(system, "state_labels") if state_names is None else state_names,
        state_units=state_units,
        measurement_names=_labels(system, "output_labels")
        if measurement_names is None
        else measurement_names,
        control_names=_labels(system, "input_labels") if control_names is None and B.any() else control_names,
    )


def _attribute(source: Any, name: str, kind: str) -> Any:
    value = getattr(source, name, None)
    if value is None:
        raise ModelError(f"{_called(source)} has no {name}: pass a {kind}")
    return value


def _called(value: Any) -> str:
    """What a message calls an object: plain data as they are, others by their class."""
    plain = value is None or isinstance(value, str | int | float | list | tuple | dict)
    return shown(value) if plain else type(value).__name__


def _numbers(source: Any, name: str) -> Array:
    """An attribute in numbers, 0 where there is none. Raises ModelError where it is something else."""
    value = getattr(source, name, None)
    try:
        return reals(0.0 if value is None else value)
    except (TypeError, ValueError, OverflowError):
        problem = f"{name} = {shown(value)} is no array of real numbers"
        raise ModelError(f"{_called(source)}: {problem}") from None


def _is_continuous(system: Any) -> bool:
    """scipy marks continuous systems by dt = None; control by dt = 0, and there None is undecided."""
    is_continuous = getattr(system, "isctime", None)
    if callable(is_continuous):
        return bool(is_continuous(strict=True))
    dt = getattr(system, "dt", None)
    return dt is not True and not as_real(dt)


def _labels(system: Any, attribute: str) -> list[str] | None:
    labels = getattr(system, attribute, None)
    if not isinstance(labels, list) or names_problem(labels):
        return None
    return labels
