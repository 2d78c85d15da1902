"""A design of every fixed-point algorithm, of two to four states, for engine and hardware to agree on."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from kalmanhdl.algorithm import (
    Algorithm,
    BiermanThornton,
    Conventional,
    Converted,
    Extended,
    Interacting,
    Joseph,
    Scheduled,
    Sequential,
    Taylor,
)
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.model.converted import converted_model
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.motion import constant_velocity
from kalmanhdl.model.multiple import multiple_model
from kalmanhdl.model.nonlinear import nonlinear_model
from kalmanhdl.model.state_space import LinearModel, linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from random_designs import covering

_DESIGNS = Path(__file__).parents[1] / "designs"
# States and measurements of the linear models, and their word lengths.
_SHAPES = ((2, 1, 16), (3, 2, 20), (4, 2, 18))
# Expansions about a covariance above those of tracks that miss a few plots converge.
_LINEAR: dict[str, Callable[[LinearModel], Algorithm]] = {
    "conventional": lambda _: Conventional(),
    "joseph": lambda _: Joseph(),
    "sequential": lambda _: Sequential(),
    "bierman_thornton": lambda _: BiermanThornton(),
    "taylor": lambda model: Taylor(covering(model)),
    "taylor_newton": lambda model: Taylor(covering(model), newton=1),
    "scheduled": lambda _: Scheduled(),
    "steady_state": lambda _: Scheduled(0),
}


def every_algorithm() -> dict[str, Callable[[], Design]]:
    """What makes each design, by its name."""
    made: dict[str, Callable[[], Design]] = {}
    for kind in _LINEAR:
        for n, m, width in _SHAPES:
            made[f"{kind}_{n}"] = lambda kind=kind, n=n, m=m, width=width: _linear(kind, n, m, width)
    made |= {"extended_2": _pendulum, "extended_3": _unicycle, "extended_4": lambda: _shipped("ekf_radar")}
    made |= {"interacting_2": lambda: _switching(2, 1), "interacting_3": lambda: _switching(3, 1)}
    made |= {"interacting_4": lambda: _shipped("imm_radar")}
    made |= {"converted_2d_2": lambda: _resting(2), "converted_3d_3": lambda: _resting(3)}
    made |= {"converted_2d_4": lambda: _shipped("dcmkf_radar"), "converted_3d_6": _flying}
    return made


def _design(name: str, model: object, algorithm: Algorithm, width: int) -> Design:
    return Design(
        name=name,
        model=model,
        algorithm=algorithm,
        numerics=FixedSpecification(width=width),
        architecture=Architecture(channels=16),
        target=Target(device="ecp5-85k", grade=8),
    )


def _shipped(name: str) -> Design:
    design = Design.load(_DESIGNS / f"{name}.toml")
    return replace(design, target=replace(design.target, device="ecp5-85k"))


def _linear(kind: str, n: int, m: int, width: int) -> Design:
    """A model without zeros, so that every algorithm has all its operations."""
    random = np.random.default_rng(n)
    F = random.standard_normal((n, n))
    F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
    Q, P, R = (_covariance(random, size) for size in (n, n, m))
    start = given(random.standard_normal(n), 4 * P)
    model = linear_model(F, random.standard_normal((m, n)), Q, R, initial=start)
    return _design(f"{kind}_{n}", model, _LINEAR[kind](model), width)


def _covariance(random: np.random.Generator, n: int) -> np.ndarray:
    root = random.standard_normal((n, n))
    return root @ root.T / n + 0.3 * np.eye(n)


def _pendulum() -> Design:
    """Särkkä, Bayesian Filtering and Smoothing (2013), example 5.1."""
    T, q = 0.0125, 0.01
    model = nonlinear_model(
        ["a + T*w", "w - 9.81*T*sin(a)"],
        ["sin(a)"],
        q * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]),
        [[0.1]],
        initial=given([1.5, 0.0], 0.1 * np.eye(2)),
        state_names=["a", "w"],
        measurement_names=["deflection"],
        constants={"T": T},
    )
    return _design("extended_2", model, Extended(), 20)


def _unicycle() -> Design:
    """A vehicle that keeps its speed and turns at random, seen from the origin by range and bearing."""
    model = nonlinear_model(
        ["x + v*T*cos(c)", "y + v*T*sin(c)", "c"],
        ["hypot(x, y)", "atan2(y, x)"],
        np.diag([0.01, 0.01, 0.0025]),
        np.diag([0.25, 0.0004]),
        initial=given([60.0, 40.0, 1.0], np.diag([1.0, 1.0, 0.01])),
        state_names=["x", "y", "c"],
        measurement_names=["range", "bearing"],
        constants={"T": 0.1, "v": 5.0},
        angles=["bearing"],
    )
    return _design("extended_3", model, Extended(), 20)


def _switching(n: int, m: int) -> Design:
    """A quiet and a lively mode of one chain of integrators."""
    F, H = np.eye(n) * 0.95 + np.eye(n, k=1) * 0.5, np.eye(m, n)
    start = given(np.zeros(n), 4 * np.eye(n))
    modes = [linear_model(F, H, q * np.eye(n), np.eye(m), initial=start) for q in (0.01, 0.5)]
    model = multiple_model(modes, [[0.95, 0.05], [0.1, 0.9]])
    return _design(f"interacting_{n}", model, Interacting(), 18)


def _resting(axes: int) -> Design:
    """A target that drifts, seen in range and angles."""
    sigma = [5.0, 0.03, 0.02][:axes]
    model = converted_model(
        np.eye(axes),
        np.eye(axes),
        np.eye(axes),
        np.diag(np.square(sigma)),
        initial=given([400.0, 300.0, 200.0][:axes], 100 * np.eye(axes)),
        state_names=["x", "y", "z"][:axes],
        measurement_range=[[100, 1000], [-np.pi, np.pi], [0.1, 1.2]][:axes],
    )
    return _design(f"converted_{axes}d_{axes}", model, Converted(), 24)


def _flying() -> Design:
    motion = constant_velocity(T=1.0, noise=1.0, axes=3)
    model = converted_model(
        motion.F,
        motion.H,
        motion.Q,
        np.diag([9.0, 0.02**2, 0.01**2]),
        initial=two_point(),
        state_names=motion.state_names,
        measurement_range=[[500, 5000], [-np.pi, np.pi], [0.1, 1.2]],
    )
    return _design("converted_3d_6", model, Converted(), 28)
