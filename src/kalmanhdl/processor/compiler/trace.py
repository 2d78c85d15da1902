"""From a linear model and an algorithm to the sections of a program."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalmanhdl.algorithm import Algorithm
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.filters import Matrices, predict, update_of
from kalmanhdl.processor.compiler.graph import (
    Array,
    Builder,
    Held,
    Matrix,
    Section,
    Vector,
    check_size,
    named,
)

HELD = ("x", "P")


@dataclass(frozen=True, slots=True, kw_only=True)
class Traced:
    """A filter on matrices of ``size``: the section that starts a track, passed ``points`` times, and a step.

    Every section reads m valid flags, 0 or 1, and m measurements; then x and the diagonal of P are put out.
    ``constants`` are read once, before the first section.
    """

    model: LinearModel
    size: int
    points: int
    start: Section
    step: Section
    constants: Mapping[str, Array]

    @property
    def outputs(self) -> tuple[tuple[str, int], ...]:
        """What is put out after every section: elements of held matrices, in order."""
        n = range(self.model.n)
        return (*(("x", i) for i in n), *(("P", i * (self.size + 1)) for i in n))


def traced(model: Model, algorithm: Algorithm, size: int) -> Traced:
    """A filter of a linear model.

    Raises ProgramError where the model or the algorithm has no program on matrices of this size.
    """
    if not isinstance(model, LinearModel):
        raise ProgramError(f"a {model.kind} model has no program yet: take a linear one")
    if model.p:
        raise ProgramError(f"the model has {model.p} controls: programs have none yet")
    check_size("states", model.n, size)
    check_size("measurements", model.m, size)
    update = update_of(algorithm, model, size)
    constants: dict[str, Array] = {}

    def begin() -> tuple[Builder, Matrices, Vector, Matrix, Vector, Matrix]:
        builder = Builder(size, constants)
        n, m = model.n, model.m
        x = Vector(builder, builder.place(Held("x")), n)
        P = Matrix(builder, builder.place(Held("P")), (n, n))
        V = Matrix(builder, builder.given("V", range(0, m * (size + 1), size + 1)), (m, m))
        z = Vector(builder, builder.given("z", range(m)), m)
        return builder, Matrices(model=model, c=_constants(builder, size)), x, P, z, V

    builder, matrices, x, P, z, V = begin()
    x1, P1 = start(matrices, x, z)
    if model.initial.before_update:
        x1, P1 = update(matrices, x1, P1, z, V)
    first = _section("start", builder, x1, P1)
    builder, matrices, x, P, z, V = begin()
    x2, P2 = predict(matrices, x, P)
    x2, P2 = update(matrices, x2, P2, z, V)
    later = _section("step", builder, x2, P2)
    return Traced(
        model=model, size=size, points=model.initial.points, start=first, step=later, constants=constants
    )


def start(matrices: Matrices, x: Any, z: Any) -> tuple[Any, Any]:
    """The belief that the command ``initialise`` makes of the state kept before and a measurement."""
    initial = matrices.model.initial
    mean = matrices.c("x0", initial.x)
    if np.any(initial.from_measurement):
        mean = mean + matrices.c("from_z", initial.from_measurement) @ z
    if np.any(initial.from_state):
        mean = mean + matrices.c("from_x", initial.from_state) @ x
    return named(mean, "start: x"), matrices.c("P0", initial.P)


def _constants(builder: Builder, size: int) -> Any:
    """What makes a constant of an array: a vector of one dimension, else a matrix."""

    def make(name: str, values: Any) -> Matrix | Vector:
        array = np.asarray(values, np.float64)
        if array.ndim == 1:
            row = builder.constant(name, array.reshape(1, -1))
            return Vector(builder, row.index, len(array))
        return builder.constant(name, array)

    return make


def _section(name: str, builder: Builder, x: Vector, P: Matrix) -> Section:
    return Section(
        name=name,
        nodes=tuple(builder.nodes),
        comments=dict(builder.comments),
        held={"x": x.index, "P": P.index},
    )
