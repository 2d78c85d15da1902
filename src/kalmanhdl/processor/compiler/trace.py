"""From a linear model and an algorithm to the sections of a program."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalmanhdl.algorithm import Algorithm
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.filters import recipe_of
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
from kalmanhdl.processor.compiler.recipe import Anything, Given, Kept, Matrices, Recipe


@dataclass(frozen=True, slots=True, kw_only=True)
class Traced:
    """A filter on matrices of ``size``: the section that starts a track, passed ``points`` times, and a step.

    Every section reads m valid flags, 0 or 1, m measurements and p controls; then x and the variances are put
    out. ``constants`` are read once, before the first section.
    """

    model: LinearModel
    recipe: Recipe
    size: int
    points: int
    start: Section
    step: Section
    constants: Mapping[str, Array]

    @property
    def held(self) -> tuple[str, ...]:
        """The matrices that stay from step to step."""
        return (*self.recipe.vectors, *self.recipe.matrices)

    @property
    def outputs(self) -> tuple[tuple[str, int], ...]:
        """What is put out after every section: elements of held matrices or constants, in order."""
        n, name = range(self.model.n), self.recipe.variances
        stride = 1 if name in self.recipe.vectors else self.size + 1
        return (*(("x", i) for i in n), *((name, i * stride) for i in n))

    def estimate(self, numbers: Mapping[str, Array]) -> tuple[Array, Array]:
        """x (n,) and P (n, n) of what the held matrices and the constants (size, size) contain."""
        n, vectors = self.model.n, self.recipe.vectors
        values = {name: each[0, :n] if name in vectors else each[:n, :n] for name, each in numbers.items()}
        return values["x"], self.recipe.covariance(values)


def traced(model: Model, algorithm: Algorithm, size: int) -> Traced:
    """A filter of a linear model.

    Raises ProgramError where the model or the algorithm has no program on matrices of this size.
    """
    if not isinstance(model, LinearModel):
        raise ProgramError(f"a {model.kind} model has no program yet: take a linear one")
    for what, count in (("states", model.n), ("measurements", model.m), ("controls", model.p)):
        check_size(what, count, size)
    recipe = recipe_of(algorithm, model, size)
    constants: dict[str, Array] = {}
    row = _Row(model=model, recipe=recipe, size=size, constants=constants)
    starts = row.section("start", _start)
    step = row.section("step", _step)
    return Traced(
        model=model,
        recipe=recipe,
        size=size,
        points=model.initial.points,
        start=starts,
        step=step,
        constants=constants,
    )


_Pass = Callable[[Recipe, Matrices, Kept, Given], Kept]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """What every section begins with."""

    model: LinearModel
    recipe: Recipe
    size: int
    constants: dict[str, Array]

    def section(self, name: str, work: _Pass) -> Section:
        """What is done to a row, as a section."""
        builder, model = Builder(self.size, self.constants), self.model
        n, m, p = model.n, model.m, model.p
        kept: dict[str, Anything] = {
            each: Vector(builder, builder.place(Held(each)), n) for each in self.recipe.vectors
        }
        kept |= {each: Matrix(builder, builder.place(Held(each)), (n, n)) for each in self.recipe.matrices}
        V = builder.given("V", range(0, m * (self.size + 1), self.size + 1))
        z = builder.given("z", range(m))
        u = Vector(builder, builder.given("u", range(p)), p) if p else None
        given = Given(z=Vector(builder, z, m), V=Matrix(builder, V, (m, m)), u=u)
        matrices = Matrices(model=model, c=_constants(builder))
        found = self.recipe.finish(matrices, work(self.recipe, matrices, kept, given))
        return Section(
            name=name,
            nodes=tuple(builder.nodes),
            comments=dict(builder.comments),
            held={each: value.index for each, value in found.items()},
        )


def _start(recipe: Recipe, matrices: Matrices, kept: Kept, given: Given) -> Kept:
    """The belief that the command ``initialise`` makes of the state kept before and a row."""
    initial = matrices.model.initial
    mean = matrices.c("x0", initial.x)
    if np.any(initial.from_measurement):
        mean = mean + matrices.c("from_z", initial.from_measurement) @ given.z
    if np.any(initial.from_state):
        mean = mean + matrices.c("from_x", initial.from_state) @ kept["x"]
    if initial.from_control is not None and np.any(initial.from_control):
        mean = mean + matrices.c("from_u", initial.from_control) @ given.u
    begun = {"x": named(mean, "start: x"), **recipe.begin(matrices)}
    return recipe.update(matrices, begun, given) if initial.before_update else begun


def _step(recipe: Recipe, matrices: Matrices, kept: Kept, given: Given) -> Kept:
    return recipe.update(matrices, recipe.predict(matrices, kept, given), given)


def _constants(builder: Builder) -> Callable[[str, Any], Anything]:
    """What makes a constant of an array: a vector of one dimension, else a matrix."""

    def make(name: str, values: Any) -> Matrix | Vector:
        array = np.asarray(values, np.float64)
        if array.ndim == 1:
            row = builder.constant(name, array.reshape(1, -1))
            return Vector(builder, row.index, len(array))
        return builder.constant(name, array)

    return make
