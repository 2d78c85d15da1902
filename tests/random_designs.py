"""Designs drawn at random: models, algorithms, formats, rounding, overflow, division, architectures."""

import numpy as np

from kalmanhdl.algorithm import ALGORITHMS, LINEAR, Algorithm, Scheduled, Taylor
from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Overflow, Rounding
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.graph.kinds import KINDS
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.state_space import LinearModel, linear_model
from kalmanhdl.model.varying import VaryingModel, varying_model
from kalmanhdl.numerics.specification import FixedSpecification

CLASSES = ("state", "covariance", "gain", "measurement", "innovation", "innovation_covariance", "reciprocal")


def random_design(
    seed: int, max_states: int = 6, max_measurements: int = 3, device: str = "ecp5-85k"
) -> Design:
    """A design that nobody would write, but that must be right all the same."""
    random = np.random.default_rng(seed)
    channels = int(random.choice([1, 1, 2, 3, 5, 8, 13, 20]))
    least = 2 if channels == 2 else 1
    interval = None if random.random() < 0.3 else int(random.integers(least, 8))
    if seed % 5 == 4:
        model = random_varying_model(random, max_states, max_measurements)
    else:
        model = _model(random, max_states, max_measurements)
    units = _units(random)
    return Design(
        name=f"random_{seed}",
        model=model,
        algorithm=_algorithm(random, model),
        numerics=_numerics(random),
        # An interval that suits a number of operators is found.
        architecture=Architecture(interval=None if units else interval, channels=channels, units=units),
        target=Target(device=device, grade=6),
    )


def random_varying_model(
    random: np.random.Generator, max_states: int = 4, max_measurements: int = 3
) -> VaryingModel:
    """States that decay and push each other the more the longer a step is, by inputs dt, q and r."""
    n = int(random.integers(1, max_states + 1))
    m = int(random.integers(1, min(n, max_measurements) + 1))
    F = [[_moved(random, i, j) for j in range(n)] for i in range(n)]
    Q = [
        [f"{a!r}*q*dt" if i == j else 0.0 for j in range(n)]
        for i, a in enumerate(random.uniform(0.1, 1, n).tolist())
    ]
    R = [
        [f"{a!r}*r + 0.1" if i == j else 0.0 for j in range(m)]
        for i, a in enumerate(random.uniform(0.5, 2, m).tolist())
    ]
    if m > 1 and random.random() < 0.5:
        R[0][1] = R[1][0] = "0.05*r"
    H = np.eye(n)[random.permutation(n)[:m]] * random.choice([1.0, -1.0, 0.7, 2.0], size=(m, 1))
    if random.random() < 0.5:
        H += random.standard_normal((m, n)) * (random.random((m, n)) < 0.5)
    high, driven = float(random.uniform(0.5, 2)), random.random() < 0.3
    return varying_model(
        F,
        H,
        Q,
        R,
        inputs=(
            RunTimeInput(name="dt", low=float(random.choice([0.0, 0.25])), high=high),
            RunTimeInput(name="q", low=0.5, high=2.0),
            RunTimeInput(name="r", low=0.0, high=float(random.choice([1.0, 3.0]))),
        ),
        initial=given(random.standard_normal(n), _covariance(random, n) * 4),
        B=[[f"{c!r}*dt"] for c in random.standard_normal(n).tolist()] if driven else None,
        offset=[f"{c!r}*dt" for c in random.standard_normal(n).tolist()] if random.random() < 0.3 else None,
        control_names=["push"] if driven else [],
    )


def _moved(random: np.random.Generator, i: int, j: int) -> str | float:
    if i == j:
        return f"1 - {float(random.uniform(0.05, 0.4))!r}*dt"
    return f"{float(random.uniform(-0.5, 0.5))!r}*dt" if j > i and random.random() < 0.7 else 0.0


def _units(random: np.random.Generator) -> dict[str, int] | None:
    """As many operators as operations, as few as the interval needs, or some of each kind."""
    way = random.random()
    if way < 0.6:
        return {} if way < 0.3 else None
    # Reciprocals of different precision do not share; a random design may have any.
    kinds = [kind for kind in KINDS if kind not in ("divide", "reciprocal")]
    return {kind: int(random.integers(1, 5)) for kind in kinds if random.random() < 0.5}


def _algorithm(random: np.random.Generator, model: LinearModel | VaryingModel) -> Algorithm:
    if isinstance(model, VaryingModel):
        return ALGORITHMS[str(random.choice(model.suited))]()
    kind = str(random.choice(sorted(LINEAR)))
    if kind == Taylor.kind:
        return Taylor(covering(model), int(random.integers(0, 2)))
    if kind == Scheduled.kind:
        return Scheduled(int(random.integers(0, 20)))
    return ALGORITHMS[kind]()


def covering(model: LinearModel, misses: int = 8) -> np.ndarray:
    """A covariance above those of tracks that miss so many plots in a row: expansions about it converge."""
    P = total = model.initial.P
    for _ in range(misses):
        P = model.F @ P @ model.F.T + model.Q
        total = total + P
    return total


def _model(random: np.random.Generator, max_states: int, max_measurements: int) -> LinearModel:
    n = int(random.integers(1, max_states + 1))
    m = int(random.integers(1, min(n, max_measurements) + 1))
    if n % 2 == 0 and random.random() < 0.3:
        return _moving(random, n)
    sparse = random.random((n, n)) < random.choice([0.3, 0.6, 1.0])
    F = np.where(sparse | np.eye(n, dtype=bool), random.standard_normal((n, n)), 0.0)
    F *= random.uniform(0.6, 1.0) / max(np.abs(np.linalg.eigvals(F)).max(), 0.1)
    if random.random() < 0.5:
        H = np.eye(n)[random.permutation(n)[:m]] * random.choice([1.0, -1.0, 0.7, 2.0], size=(m, 1))
    else:
        H = random.standard_normal((m, n)) * (random.random((m, n)) < 0.7)
        H[np.arange(m), random.permutation(n)[:m]] += 1.0
    controls = int(random.random() < 0.3)
    return linear_model(
        F,
        H,
        _covariance(random, n),
        _covariance(random, m) if random.random() < 0.4 else np.diag(random.uniform(0.1, 3.0, m)),
        initial=given(random.standard_normal(n), _covariance(random, n) * 4),
        B=random.standard_normal((n, controls)),
        offset=random.standard_normal(n) * (random.random() < 0.3),
        measurement_offset=random.standard_normal(m) * (random.random() < 0.3),
    )


def _moving(random: np.random.Generator, n: int) -> LinearModel:
    """Constant velocity on n / 2 axes, started from two points."""
    axes, T = n // 2, float(random.choice([0.5, 1.0, 1.68, 15.0]))
    F = np.kron(np.eye(axes), np.array([[1.0, T], [0.0, 1.0]]))
    H = np.kron(np.eye(axes), np.array([[1.0, 0.0]]))
    noise = random.uniform(0.01, 10.0, axes)
    Q = np.kron(np.diag(noise), np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]))
    return linear_model(F, H, Q, np.diag(random.uniform(0.1, 100.0, axes)), initial=two_point())


def _covariance(random: np.random.Generator, n: int) -> np.ndarray:
    root = random.standard_normal((n, n))
    return root @ root.T / n + 0.2 * np.eye(n)


def _numerics(random: np.random.Generator) -> FixedSpecification:
    chosen = {name: int(random.integers(5, 28)) for name in CLASSES if random.random() < 0.5}
    return FixedSpecification(
        width=int(random.integers(6, 30)),
        classes={**chosen, "constant": int(random.integers(4, 19))},
        rounding=Rounding(random.choice([mode.value for mode in Rounding])),
        overflow=Overflow(random.choice([mode.value for mode in Overflow])),
        division=_division(random),
    )


def _division(random: np.random.Generator) -> DivisionMethod:
    if random.random() < 0.5:
        return LongDivision(radix=int(random.choice([2, 4])))
    return TableNewton(index_bits=int(random.integers(3, 9)), iterations=int(random.integers(0, 3)))
