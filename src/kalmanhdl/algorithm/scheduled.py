"""The filter whose gains are computed when it is built."""

import warnings
from dataclasses import dataclass
from itertools import islice, takewhile
from typing import ClassVar, Literal

import numpy as np

from kalmanhdl.algorithm import steady_state
from kalmanhdl.algorithm.covariance import innovation, predict_mean, start_mean
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given, as_linear
from kalmanhdl.algorithm.memory import COUNTER, Kept, Kind, Memory
from kalmanhdl.graph.linear_algebra import vector
from kalmanhdl.graph.signal import Array, Scalar, both, named, opposite, row, select
from kalmanhdl.model.model import Array as Numbers
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.validation import InvalidValueError, KalmanhdlWarning, as_integer, shown

MAX_STEPS = 1023
# "auto" ends where no entry of the gain is farther from the steady one than this part of its deviations.
_NEAR, _MOST = 1 / 256, 63
# Beside the deviations of what it links, an entry this small is rounding.
_ROUNDING = 1e-13


@dataclass(frozen=True, slots=True)
class Scheduled(Algorithm):
    """Gains from a table for the first ``steps`` updates of a track, then the steady gain; no covariance.

    K = P H' S^-1 and P by lee1997 eq. 4 to 8 in double precision when the filter is built, from the model's
    own start to the steady state (Anderson & Moore, Optimal Filtering, 1979, chapter 4). The table holds
    the next power of two of gains, the last of them the steady one. ``steps = 0`` is the steady gain alone;
    "auto" goes on until the gain is within 1/256 of it, or for 63 updates, with a warning. A counter of
    updates is all that is kept beside the mean.

    The gains are the optimal ones as long as nothing is missed. A missed component has no gain, and a step
    without any predicts and is not counted; the gains of the others, the covariance put out and ``nis``
    remain what they would be without the miss. That is an approximation: choose another algorithm where
    misses are frequent.

    Multiplications of signals for dense H: n m, and m^2 for ``nis``; with ``steps = 0`` by constants alone.
    No reciprocals. Choose it for models that do not change and sensors that do not miss: nothing is smaller,
    nothing has a shorter loop.
    """

    steps: int | Literal["auto"] = "auto"
    kind: ClassVar[str] = "scheduled"
    when_missed: ClassVar[str] = "goes on with the gains of a track that misses nothing, an approximation"

    def __post_init__(self) -> None:
        if isinstance(self.steps, str) and self.steps == "auto":
            return
        steps = as_integer(self.steps)
        if steps is None or not 0 <= steps <= MAX_STEPS:
            problem = f' = {shown(self.steps)}: "auto", or an integer from 0 to {MAX_STEPS}'
            raise InvalidValueError("algorithm", "steps", problem)
        object.__setattr__(self, "steps", steps)

    def __call__(self, model: Model) -> Filter:
        """The filter of a linear model. Raises ModelError where the model has no steady state.

        Warns with KalmanhdlWarning where "auto" ends far from the steady gain.
        """
        linear = as_linear(model, self)
        table = _table(linear, self._count(linear))
        bits = Kept(COUNTER, Kind.NUMBER, (len(table.following),))
        return Filter(
            kept=(Kept("x", Kind.STATE, (linear.n,)), bits),
            start=lambda memory, given: {
                "x": start_mean(linear, memory["x"], given),
                COUNTER: np.zeros(bits.shape, object),
            },
            predict=lambda memory, given: {
                "x": predict_mean(linear, memory["x"], given),
                COUNTER: memory[COUNTER],
            },
            update=lambda memory, given: _update(linear, table, memory, given),
            estimate=lambda memory: Belief(memory["x"], _looked_up(_number(memory[COUNTER]), table.P)),
            before_update=linear.initial.before_update,
        )

    def in_units(self, model: Model, covariance: Numbers) -> Algorithm:
        """The same number of gains, whatever the units."""
        return Scheduled(self._count(as_linear(model, self)))

    def _count(self, model: LinearModel) -> int:
        return self.steps if isinstance(self.steps, int) else _approach(model)


@dataclass(frozen=True, slots=True)
class _Table:
    """By number of updates before (N of them): K (N, n, m), S^-1 (N, m, m), and the number after the next
    update in bits, the least one first (b, N). By number of updates so far: P (N, n, n)."""

    K: Numbers
    S_inverse: Numbers
    P: Numbers
    following: Numbers


def _table(model: LinearModel, steps: int) -> _Table:
    bits = steps.bit_length()
    count = 1 << bits
    steady = steady_state.steady_prior(model)
    prior = np.array([*islice(steady_state.priors(model), count - 1), steady])
    S = np.array([steady_state.innovation_covariance(model, P) for P in prior])
    K = np.array([steady_state.optimal_gain(model, P) for P in prior])
    after = [steady_state.corrected(model, P) for P in prior]
    deviation, spread = _deviations(prior), _deviations(S)
    S_inverse = np.linalg.inv(S)
    following = np.minimum(np.arange(count) + 1, count - 1)
    return _Table(
        K=_without_rounding(K, deviation[:, :, None] / spread[:, None, :]),
        S_inverse=_without_rounding(S_inverse, 1 / (spread[:, :, None] * spread[:, None, :])),
        P=np.array([model.initial.P, *after[: count - 2], after[-1]]) if bits else np.array(after),
        following=np.array([following >> bit & 1 for bit in range(bits)], float),
    )


def _deviations(P: Numbers) -> Numbers:
    return np.asarray(np.sqrt(np.maximum(np.einsum("...ii->...i", P), 0.0)))


def _without_rounding(entries: Numbers, size: Numbers) -> Numbers:
    """The entries, those zero that are nothing but rounding in every row of the table."""
    real = np.any(np.abs(entries) > _ROUNDING * size, axis=0)
    return np.where(real, entries, 0.0)


def _approach(model: LinearModel) -> int:
    """After how many updates the gain stays near the steady one."""
    steady = steady_state.steady_prior(model)
    last = steady_state.optimal_gain(model, steady)
    with np.errstate(divide="ignore"):
        weight = np.outer(
            1 / _deviations(steady), _deviations(steady_state.innovation_covariance(model, steady))
        )
    weight[~np.isfinite(weight)] = 0.0
    path = islice(steady_state.priors(model), _MOST + 1)
    distance = [float((np.abs(steady_state.optimal_gain(model, P) - last) * weight).max()) for P in path]
    near = sum(1 for _ in takewhile(lambda d: d <= _NEAR, reversed(distance)))
    if not near:
        warnings.warn(
            f'[algorithm] steps = "auto" ends after {_MOST} updates, while the gain is still '
            f"{distance[-1]:.2g} of its size away from the steady one: write a larger number, or choose "
            '"conventional"',
            KalmanhdlWarning,
            stacklevel=4,
        )
    return min(len(distance) - near, _MOST)


def _update(model: LinearModel, table: _Table, memory: Memory, given: Given) -> Correction:
    number = _number(memory[COUNTER])
    y = innovation(model, memory["x"], given)
    K = named("update: K", _looked_up(number, table.K))
    weighted = named("update: Siy", _looked_up(number, table.S_inverse) @ y)
    squares = weighted * y
    nis = squares.sum() if model.nis_weight is None else squares @ model.nis_weight.astype(object)
    nothing = opposite(given.valid[0])
    for flag in given.valid[1:]:
        nothing = both(nothing, opposite(flag))
    bits = vector(
        select(nothing, bit, row(number, after))
        for bit, after in zip(memory[COUNTER], table.following, strict=True)
    )
    return Correction({"x": named("update: x", memory["x"] + K @ y), COUNTER: bits}, y, nis)


def _number(bits: Array) -> Scalar:
    number: Scalar = 0.0
    for place, bit in enumerate(bits):
        number = number + bit * float(1 << place)
    return number


def _looked_up(number: Scalar, table: Numbers) -> Array:
    """The matrix of a number in a table (N, ...)."""
    result = np.empty(table.shape[1:], object)
    for place in np.ndindex(*result.shape):
        result[place] = row(number, table[(slice(None), *place)].tolist())
    return result
