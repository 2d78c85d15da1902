"""The converted measurement filter: a linear filter of positions that every row converts anew."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from kalmanhdl.algorithm.conventional import conventional_correction
from kalmanhdl.algorithm.covariance import innovation, predict_covariance, predict_mean
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given, unsuited
from kalmanhdl.algorithm.memory import Kept, Kind, Memory
from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, both, named, negative, select
from kalmanhdl.model.conversion import UNBIASINGS, Conversion, Unbiasing, conversion
from kalmanhdl.model.converted import ConvertedModel
from kalmanhdl.model.model import Model
from kalmanhdl.validation import InvalidValueError, shown

At = Literal["measurement", "prediction", "better"]
ATS = ("measurement", "prediction", "better")


@dataclass(frozen=True, slots=True)
class Converted(Algorithm):
    """Range and angles become a position with its covariance R, and that updates as ``Conventional`` does.

    ``unbiasing``: see ``model.conversion.conversion``; ``"debiased"`` is the filter of Lerro & Bar-Shalom
    (1993) and of wu2012. ``at``: where R is evaluated, at the ``"measurement"``, at the ``"prediction"``,
    which leaves R and with it the gain uncorrelated with the noise of the row (Bordonaro, Willett &
    Bar-Shalom 2014), or at the ``"better"`` of both, as Lerro & Bar-Shalom recommend: the one of less
    mean square error, the trace of its covariance. The position itself is always the measurement's.

    A row counts only as a whole: where one of its components is missed, all are. Innovations are those of
    the position, and ``nis`` theirs. Multiplications of signals for n states and m components: those of
    ``Conventional`` for m positions, and what no n changes, the conversion: about 20 in the plane and 60 in
    space, twice that for ``"better"``; a sine and a cosine for each angle.

    Choose it where the motion is linear in x, y and z and the error across the line of sight is large beside
    that along it: its covariance holds where the slopes of ``Extended`` no longer do.

    Raises:
        DesignError: an option that is none.
    """

    kind: ClassVar[str] = "converted_measurement"

    unbiasing: Unbiasing = "debiased"
    at: At = "measurement"

    def __post_init__(self) -> None:
        for key, words in (("unbiasing", UNBIASINGS), ("at", ATS)):
            word = getattr(self, key)
            if not isinstance(word, str) or word not in words:
                hint = ", ".join(f'"{word}"' for word in words)
                problem = f" = {shown(getattr(self, key))}: write one of {hint}"
                raise InvalidValueError("algorithm", key, problem)

    def __call__(self, model: Model) -> Filter:
        """The filter of a model of converted measurements."""
        if not isinstance(model, ConvertedModel):
            raise unsuited(model, self)
        how, n = conversion(model.variances, self.unbiasing), model.n
        return Filter(
            kept=(Kept("x", Kind.STATE, (n,)), Kept("P", Kind.COVARIANCE, (n, n))),
            start=lambda memory, given: _start(model, how, memory, given),
            predict=lambda memory, given: {
                "x": predict_mean(model.positions, memory["x"], given),
                "P": predict_covariance(model.positions, memory["P"]),
            },
            update=lambda memory, given: _update(model, how, self.at, memory, given),
            estimate=lambda memory: Belief(memory["x"], memory["P"]),
            before_update=model.initial.before_update,
        )


@dataclass(frozen=True, slots=True)
class _Position:
    """A position with the covariance of its row: see ``gain.Observation``."""

    n: int
    H: Array
    R: Array
    nis_weight: Array | None


def _start(model: ConvertedModel, how: Conversion, memory: Memory, given: Given) -> Memory:
    if model.initial.takes_measurements:
        x, P = model.started(how, memory["x"], given.z, given.u)
    else:
        # Nothing of the row is looked at.
        x, P = model.initial.mean(memory["x"], given.z, given.u), model.initial.P.astype(object)
    return {"x": named("initialise: x", x), "P": named("initialise: P", symmetric(P))}


def _update(model: ConvertedModel, how: Conversion, at: At, memory: Memory, given: Given) -> Correction:
    z = named("convert: z", model.converted(how, given.z))
    R = named("convert: R", symmetric(_covariance(model, how, at, memory, given.z)))
    seen = given.valid[0]
    for flag in given.valid[1:]:
        seen = both(seen, flag)
    positions = model.positions
    seen_position = _Position(model.n, positions.H, R, positions.nis_weight)
    row = Given(z, (seen,) * model.m, given.u, given.initialise)
    y = innovation(positions, memory["x"], row)
    prior = Belief(memory["x"], memory["P"])
    correction = conventional_correction(seen_position, prior, row.valid, y)
    # Innovations are put out in the units of the measurements that they stand for.
    scale = model.units.measurement[0] / model.units.measurement
    return Correction(correction.memory, correction.innovation * scale, correction.nis)


def _covariance(model: ConvertedModel, how: Conversion, at: At, memory: Memory, z: Array) -> Array:
    if at == "measurement":
        return model.covariance(how, model.sight(z))
    predicted = model.covariance(how, model.sight_of(memory["x"]))
    if at == "prediction":
        return predicted
    measured = model.covariance(how, model.sight(z))
    H = model.positions.H.astype(object)
    better = negative(_trace(H @ memory["P"] @ H.T) - _trace(measured))
    result = np.empty_like(measured)
    for place in np.ndindex(*measured.shape):
        result[place] = select(better, predicted[place], measured[place])
    return result


def _trace(matrix: Array) -> Any:
    return sum(matrix[i, i] for i in range(1, len(matrix))) + matrix[0, 0]
