"""Interacting multiple models: a filter for each mode, mixed by how probable the modes are."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from kalmanhdl.algorithm.conventional import conventional_update
from kalmanhdl.algorithm.covariance import predict_covariance, predict_mean, start_mean
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given, unsuited
from kalmanhdl.algorithm.memory import Kept, Kind, Memory
from kalmanhdl.graph.linear_algebra import pivot_reciprocals, symmetric, times, vector
from kalmanhdl.graph.signal import Array, Scalar, both, minimum, named, select
from kalmanhdl.math import exp, sqrt
from kalmanhdl.model.model import Model
from kalmanhdl.model.multiple import MultipleModel
from kalmanhdl.model.state_space import LinearModel


@dataclass(frozen=True, slots=True)
class Interacting(Algorithm):
    """The interacting multiple model filter (Blom & Bar-Shalom, 1988).

    Mixing, mode probabilities and combination as in Bar-Shalom, Li & Kirubarajan (2001), section 11.6.6. The
    likelihoods are taken relative to the best mode's exponent, so that they neither vanish nor overflow, and
    the probabilities are divided by their sum in every step. The innovation put out is the modes' mean by
    their predicted probabilities, and so is the normalised innovation squared.

    Choose it for targets that manoeuvre at times: the quiet mode smooths, the agile one follows.
    Multiplications of signals for r modes: r times those of ``conventional``, r^2 (n^2 + 4 n) for mixing
    and r (n^2 + 4 n) for the combination; r m + r + 1 reciprocals, r roots and r exponentials.
    """

    kind: ClassVar[str] = "interacting"

    def __call__(self, model: Model) -> Filter:
        """The filter of a model of several modes."""
        if not isinstance(model, MultipleModel):
            raise unsuited(model, self)
        modes, n, r = model.modes, model.first.n, len(model.modes)
        return Filter(
            kept=(
                Kept("x", Kind.STATE, (r, n)),
                Kept("P", Kind.COVARIANCE, (r, n, n)),
                Kept("mu", Kind.NUMBER, (r,)),
            ),
            start=lambda memory, given: _start(model, memory, given),
            predict=lambda memory, given: _predict(model, memory, given),
            update=lambda memory, given: _update(modes, memory, given),
            estimate=_combined,
            before_update=model.first.initial.before_update,
            shown=("mu",),
        )


def _start(model: MultipleModel, memory: Memory, given: Given) -> Memory:
    # What earlier commands of a start left in the state is the same for every mode.
    x = [start_mean(mode, memory["x"][0], given) for mode in model.modes]
    return {
        "x": np.stack(x),
        "P": np.stack([mode.initial.P.astype(object) for mode in model.modes]),
        "mu": model.probabilities.astype(object),
    }


def _predict(model: MultipleModel, memory: Memory, given: Given) -> Memory:
    """Mix, then predict every mode; ``mu`` becomes the predicted probabilities."""
    x, P, mu = memory["x"], memory["P"], memory["mu"]
    joint = model.transition_probabilities.astype(object) * mu[:, None]
    predicted = named("predict: mu", joint.sum(axis=0))
    means, covariances = [], []
    for j, mode in enumerate(model.modes):
        weights = named("mix: w", times(joint[:, j], 1.0 / predicted[j]))
        mean = named("mix: x", weights @ x)
        covariance = _spread(weights, x, P, mean)
        means.append(predict_mean(mode, mean, given))
        covariances.append(predict_covariance(mode, covariance))
    return {"x": np.stack(means), "P": np.stack(covariances), "mu": predicted}


def _spread(weights: Array, x: Array, P: Array, mean: Array) -> Array:
    """The covariance of a mixture: sum of w (P + (x - mean)(x - mean)')."""
    total = np.zeros(P.shape[1:], object)
    for w, xi, Pi in zip(weights, x, P, strict=True):
        d = xi - mean
        total = total + symmetric(times(Pi, w) + np.multiply.outer(times(d, w), d))
    return named("mix: P", symmetric(total))


def _update(modes: tuple[LinearModel, ...], memory: Memory, given: Given) -> Correction:
    predicted = memory["mu"]
    corrections = [
        conventional_update(mode, Belief(x, P), given)
        for mode, x, P in zip(modes, memory["x"], memory["P"], strict=True)
    ]
    squares = [correction.nis for correction in corrections]
    least = squares[0]
    for square in squares[1:]:
        least = minimum(least, square)
    weights = np.empty(len(modes), object)
    for j, (mode, P) in enumerate(zip(modes, memory["P"], strict=True)):
        likelihood = _density(mode, P, given) * exp((least - squares[j]) * 0.5)
        weights[j] = predicted[j] * likelihood
    named("update: weight", weights)
    memory = {
        "x": np.stack([each.memory["x"] for each in corrections]),
        "P": np.stack([each.memory["P"] for each in corrections]),
        "mu": named("update: mu", times(weights, 1.0 / weights.sum())),
    }
    innovations = np.stack([each.innovation for each in corrections])
    return Correction(memory, named("update: ymix", predicted @ innovations), predicted @ vector(squares))


def _density(mode: LinearModel, P: Array, given: Given) -> Any:
    """1 / sqrt(det S) over the components that are valid."""
    H = mode.H.astype(object)
    S = symmetric(H @ (P @ H.T) + mode.R.astype(object))
    for j, k in np.ndindex(*S.shape):
        if j == k:
            S[j, j] = select(given.valid[j], S[j, j], 1.0)
        else:
            S[j, k] = select(both(given.valid[j], given.valid[k]), S[j, k], 0.0)
    product: Scalar = 1.0
    for reciprocal in pivot_reciprocals(S):
        product = product * reciprocal
    return sqrt(product)


def _combined(memory: Memory) -> Belief:
    x, P, mu = memory["x"], memory["P"], memory["mu"]
    mean = named("output: x", mu @ x)
    return Belief(mean, _spread(mu, x, P, mean))
