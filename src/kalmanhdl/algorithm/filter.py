"""What every algorithm is: a filter that starts, predicts and updates what it keeps between steps.

All functions are written over arrays of elements: floats for the reference, arrays over tracks for
Monte Carlo, Signals for the graph of the hardware.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from kalmanhdl.algorithm.memory import Kept, Memory
from kalmanhdl.graph.signal import Array, Condition, both, named, opposite
from kalmanhdl.model.model import Array as Numbers
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.validation import InvalidModelValueError


@dataclass(frozen=True, slots=True)
class Belief:
    """Mean x (n,) and covariance P (n, n)."""

    x: Array
    P: Array


@dataclass(frozen=True, slots=True)
class Given:
    """The data of one step: measurements z (m,), a valid flag for each, controls u (p,), command."""

    z: Array
    valid: tuple[Condition, ...]
    u: Array
    initialise: Condition


@dataclass(frozen=True, slots=True)
class Correction:
    """What an update makes of an a priori memory, with the innovation y (m,) that it rests on.

    A missed component has innovation zero and does not count in ``nis``, which is y' S^-1 y over the
    components that are valid.
    """

    memory: Memory
    innovation: Array
    nis: Any


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a step gives: the memory for the next one, the estimate, the innovation and its square."""

    memory: Memory
    belief: Belief
    innovation: Array
    nis: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Filter:
    """An algorithm on a model, as functions of what is kept and what is given.

    ``start`` makes the memory of a track's first step; with ``before_update`` it is an a priori one,
    which the valid measurements of the same row then update. ``estimate`` reads mean and covariance out
    of a memory. The arrays named in ``shown`` are put out as well.
    """

    kept: tuple[Kept, ...]
    start: Callable[[Memory, Given], Memory]
    predict: Callable[[Memory, Given], Memory]
    update: Callable[[Memory, Given], Correction]
    estimate: Callable[[Memory], Belief]
    before_update: bool
    shown: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Algorithm:
    """A choice of algorithm with its options; called with a model it is the filter.

    The fields of a subclass are the keys of [algorithm] beside ``kind``.
    """

    kind: ClassVar[str]
    # What it does where measurements are missed, if that is not the optimal thing.
    when_missed: ClassVar[str] = ""

    def __call__(self, model: Model) -> Filter:
        """The filter of a model. Raises ModelError where the algorithm does not suit the model."""
        raise NotImplementedError

    def in_units(self, model: Model, covariance: Numbers) -> "Algorithm":
        """The same choice for ``model`` in units in which P (n, n) is divided by ``covariance``."""
        return self

    def trouble(self, model: Model, coast: int) -> str:
        """What goes wrong when ``coast`` measurements in a row are missed, and what helps; empty: nothing."""
        return ""


def step(filter_: Filter, memory: Memory, given: Given) -> Outcome:
    """One command on one track: initialise, or predict and then update with what is valid.

    A command ``predict`` is an update in which no component is valid.
    """
    started = filter_.start(memory, given)
    prior = filter_.predict(memory, given)
    if filter_.before_update:
        correction = filter_.update(_either(filter_, given.initialise, started, prior), given)
        posterior = correction.memory
    else:
        running = opposite(given.initialise)
        valid = tuple(both(flag, running) for flag in given.valid)
        correction = filter_.update(prior, Given(given.z, valid, given.u, given.initialise))
        posterior = _either(filter_, given.initialise, started, correction.memory)
    posterior = {name: named(f"posterior: {name}", array) for name, array in posterior.items()}
    belief = filter_.estimate(posterior)
    belief = Belief(named("output: x", belief.x), named("output: P", belief.P))
    return Outcome(posterior, belief, correction.innovation, correction.nis)


def _either(filter_: Filter, condition: Condition, a: Memory, b: Memory) -> Memory:
    return {kept.name: kept.chosen(condition, a[kept.name], b[kept.name]) for kept in filter_.kept}


def as_linear(model: Model, algorithm: Algorithm) -> LinearModel:
    """The model, for an algorithm that needs F and H. Raises ModelError where it has none."""
    if not isinstance(model, LinearModel):
        raise unsuited(model, algorithm)
    return model


def unsuited(model: Model, algorithm: Algorithm) -> InvalidModelValueError:
    """The error for an algorithm that does not suit a model."""
    instead = " or ".join(f'"{kind}"' for kind in model.suited)
    problem = f' = "{algorithm.kind}" does not suit a {model.kind} model: use {instead}'
    return InvalidModelValueError("algorithm", "kind", problem)
