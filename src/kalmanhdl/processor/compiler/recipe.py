"""What a compiled filter is: what it keeps from row to row, and what a row does to it, on whole matrices."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalmanhdl.algorithm import steady_state
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.graph import Array, named
from kalmanhdl.processor.compiler.samples import samples

Anything = Any
"""A traced matrix or vector."""

Filtered = LinearModel | NonlinearModel
"""The models that have programs."""

Kept = Mapping[str, Anything]
"""What is kept, by name; the mean is ``x``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Matrices:
    """The matrices of a model as constants. ``c(name, values)`` makes a further one."""

    model: Any
    c: Callable[[str, Any], Anything]

    def __getattr__(self, name: str) -> Anything:
        return self.c(name, getattr(self.model, name))


@dataclass(frozen=True, slots=True, kw_only=True)
class Given:
    """What a row has: measurements z, the diagonal V of their flags, controls u if there are any."""

    z: Anything
    V: Anything
    u: Anything


Work = Callable[[Matrices, Kept, Given], Kept]
"""What takes what is kept to what it becomes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Work that is done so many times, on what the stage before left; what it does not give back is lost."""

    name: str
    work: Work
    times: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """A filter on whole matrices.

    It keeps ``vectors``, the mean x among them, and ``matrices``. ``begin`` is what a track starts with
    beside x, which the model's start says; with ``start`` all of it is what that gives. ``predict`` and
    ``update`` take what is kept to what it becomes; ``finish`` adds what is put out and not needed.
    ``variances`` is the vector or the matrix with the variances, a constant where it is not kept;
    ``covariance`` makes P of the numbers that are kept. ``stages`` are prediction and update in fewer words:
    what repeats is a loop over matrices that turn.
    """

    vectors: tuple[str, ...]
    matrices: tuple[str, ...]
    begin: Callable[[Matrices], Kept]
    predict: Work
    update: Work
    finish: Callable[[Matrices, Kept], Kept]
    variances: str
    covariance: Callable[[Mapping[str, Array]], Array]
    stages: tuple[tuple[Stage, ...], tuple[Stage, ...]] | None = None
    start: Work | None = None

    @property
    def short(self) -> tuple[tuple[Stage, ...], tuple[Stage, ...]]:
        """The stages of prediction and of update; one each where nothing repeats."""
        apart = (Stage(name="step", work=self.predict),), (Stage(name="update", work=self.update),)
        return apart if self.stages is None else self.stages


def predicted_mean(model: Matrices, x: Anything, given: Given) -> Anything:
    """F x + B u, with its offset."""
    x = named(model.F @ x, "predict: x")
    if model.model.p:
        x = named(x.plus(model.B, given.u), "predict: x with controls")
    if np.any(model.model.offset):
        x = named(x + model.offset, "predict: x with its offset")
    return x


def measured(model: Matrices, z: Anything) -> Anything:
    """A measurement without its offset."""
    if not np.any(model.model.measurement_offset):
        return z
    return named(z - model.measurement_offset, "update: z without its offset")


def near_one(model: Filtered) -> Any:
    """The powers of two, on a diagonal, that bring the variances of the settled innovations near one."""
    return np.diag(2.0 ** np.round(-0.5 * np.log2(_settled_variances(model))))


def _settled_variances(model: Filtered) -> Array:
    if isinstance(model, NonlinearModel):
        return samples(model).innovation
    S = steady_state.innovation_covariance(model, steady_state.steady_prior(model))
    return np.asarray(np.diag(S))
