"""From a model and an algorithm to the sections of a program."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kalmanhdl.algorithm import Algorithm
from kalmanhdl.errors import ProgramError
from kalmanhdl.graph.operations import Function
from kalmanhdl.model.model import Model
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.filters import recipe_of
from kalmanhdl.processor.compiler.graph import (
    Array,
    Builder,
    Computed,
    Held,
    Matrix,
    Node,
    Section,
    Vector,
    check_size,
    named,
)
from kalmanhdl.processor.compiler.recipe import (
    Anything,
    Filtered,
    Given,
    Kept,
    Matrices,
    Recipe,
    Stage,
    Work,
)
from kalmanhdl.processor.instructions import FUNCTIONS, Opcode


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A section that is passed so many times."""

    section: Section
    times: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Traced:
    """A filter on matrices of ``size``, as blocks.

    A row of data is ``start``, for the first ``points`` rows of a track, or ``step``; ``shared`` follows a
    step, and a start that ``joins``. The first block reads m valid flags, 0 or 1, m measurements and p
    controls; after the last one x and the variances are put out. ``constants`` are read once, before anything
    else; ``vectors`` are those of the matrices that stay which have a first row alone.
    """

    model: Filtered
    recipe: Recipe
    size: int
    start: tuple[Block, ...]
    step: tuple[Block, ...]
    shared: tuple[Block, ...]
    joins: bool
    constants: Mapping[str, Array]
    vectors: frozenset[str]

    @property
    def points(self) -> int:
        """Rows of a start."""
        return self.model.initial.points

    def row(self, number: int) -> tuple[Block, ...]:
        """The blocks of a row, from 0."""
        if number >= self.points:
            return (*self.step, *self.shared)
        return (*self.start, *self.shared) if self.joins else self.start

    @property
    def outputs(self) -> tuple[tuple[str, int], ...]:
        """What is put out after every row: elements of held matrices or constants, in order."""
        n, name = range(self.model.n), self.recipe.variances
        stride = 1 if name in self.recipe.vectors else self.size + 1
        return (*(("x", i) for i in n), *((name, i * stride) for i in n))

    @property
    def functions(self) -> tuple[Function, ...]:
        """The functions that its core needs, in the order of their numbers."""
        numbers = self._immediates(Opcode.FUNC)
        return tuple(each for number, each in enumerate(FUNCTIONS) if number in numbers)

    @property
    def exponents(self) -> frozenset[int]:
        """The powers of two that it scales by."""
        return self._immediates(Opcode.SCALE)

    def _immediates(self, opcode: Opcode) -> frozenset[int]:
        return frozenset(
            node.immediate
            for block in (*self.start, *self.step, *self.shared)
            for node in block.section.nodes
            if isinstance(node, Computed) and node.opcode is opcode
        )

    def estimate(self, numbers: Mapping[str, Array]) -> tuple[Array, Array]:
        """x (n,) and P (n, n) of what the held matrices and the constants (size, size) contain."""
        n, vectors = self.model.n, self.recipe.vectors
        values = {name: each[0, :n] if name in vectors else each[:n, :n] for name, each in numbers.items()}
        return values["x"], self.recipe.covariance(values)


def traced(model: Model, algorithm: Algorithm, size: int, *, short: bool = False) -> Traced:
    """A filter of a linear or a nonlinear model: a row in one section, or ``short``, with loops.

    Raises ProgramError where the model or the algorithm has no program on matrices of this size.
    """
    if not isinstance(model, LinearModel | NonlinearModel):
        raise ProgramError(f"a {model.kind} model has no program: take a linear or a nonlinear one")
    for what, count in (("states", model.n), ("measurements", model.m), ("controls", model.p)):
        check_size(what, count, size)
    recipe = recipe_of(algorithm, model, size)
    blocks = _Blocks(model=model, recipe=recipe, size=size)
    start, step, shared = blocks.short() if short else blocks.fast()
    return Traced(
        model=model,
        recipe=recipe,
        size=size,
        start=start,
        step=step,
        shared=shared,
        joins=short and blocks.joins,
        constants=blocks.constants,
        vectors=frozenset(name for name, form in blocks.forms.items() if isinstance(form, int)),
    )


Form = int | tuple[int, ...]
"""The length of a vector, or the shape of a matrix."""

Parts = tuple[tuple[Block, ...], tuple[Block, ...], tuple[Block, ...]]


@dataclass(slots=True, kw_only=True)
class _Blocks:
    """What is traced so far: constants, and the forms of the matrices that stay."""

    model: Filtered
    recipe: Recipe
    size: int
    constants: dict[str, Array] = field(default_factory=dict)
    forms: dict[str, Form] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = self.model.n
        self.forms |= dict.fromkeys(self.recipe.vectors, n)
        self.forms |= dict.fromkeys(self.recipe.matrices, (n, n))

    def fast(self) -> Parts:
        """A row in one section."""
        recipe = self.recipe

        def start(m: Matrices, kept: Kept, given: Given) -> Kept:
            return recipe.finish(m, self._begun(m, kept, given))

        def step(m: Matrices, kept: Kept, given: Given) -> Kept:
            return recipe.finish(m, recipe.update(m, recipe.predict(m, kept, given), given))

        held = self._held
        first = self._section("start", start, held, reads=True)
        return (first,), (self._section("step", step, held, reads=True),), ()

    def short(self) -> Parts:
        """Prediction and update apart, which start and step share, and what repeats in loops."""
        recipe = self.recipe

        def start(m: Matrices, kept: Kept, given: Given) -> Kept:
            if self.joins:
                return _begun(recipe, m, kept, given)
            return recipe.finish(m, self._begun(m, kept, given))

        first = self._section("start", start, self._held, reads=True)
        predict, update = recipe.short
        step = self._chain(predict, self._held, reads=True)
        shared = self._chain(update, tuple(step[-1].section.held), reads=False)
        end = self._section("finish", lambda m, kept, given: recipe.finish(m, kept), self._held, reads=False)
        return (first,), step, (*shared, end)

    @property
    def joins(self) -> bool:
        """Whether a start of one row can go on with the update of a step."""
        return self.model.initial.before_update and self.model.initial.points == 1

    def _begun(self, m: Matrices, kept: Kept, given: Given) -> Kept:
        """What the row of a start leaves."""
        begun = _begun(self.recipe, m, kept, given)
        return self.recipe.update(m, begun, given) if self.model.initial.before_update else begun

    @property
    def _held(self) -> tuple[str, ...]:
        return (*self.recipe.vectors, *self.recipe.matrices)

    def _chain(self, stages: Sequence[Stage], known: Sequence[str], *, reads: bool) -> tuple[Block, ...]:
        """Stages one after the other; the first one of a row reads it."""
        blocks: list[Block] = []
        for stage in stages:
            first = reads and not blocks
            block = self._section(stage.name, stage.work, known, reads=first)
            blocks.append(replace(block, times=stage.times))
            known = tuple(block.section.held)
        return tuple(blocks)

    def _section(self, name: str, work: Work, known: Sequence[str], *, reads: bool) -> Block:
        """Work on matrices that stay, as a section."""
        builder, model = Builder(self.size, self.constants), self.model
        kept = {each: self._placed(builder, Held(each), self.forms[each]) for each in known}
        given = self._given(builder, reads=reads)
        found = work(Matrices(model=model, c=_constants(builder)), kept, given)
        for each, value in found.items():
            self.forms.setdefault(each, value.length if isinstance(value, Vector) else value.shape)
        section = Section(
            name=name,
            nodes=tuple(builder.nodes),
            comments=dict(builder.comments),
            held={each: value.index for each, value in found.items()},
        )
        return Block(section=section)

    def _placed(self, builder: Builder, node: Node, form: Form) -> Anything:
        index = builder.place(node)
        return Vector(builder, index, form) if isinstance(form, int) else Matrix(builder, index, form)

    def _given(self, builder: Builder, *, reads: bool) -> Given:
        """The row: read, or as it stands since it was read."""
        m, p = self.model.m, self.model.p
        elements = {"V": range(0, m * (self.size + 1), self.size + 1), "z": range(m), "u": range(p)}
        forms: dict[str, Form] = {"V": (m, m), "z": m, "u": p}
        found: dict[str, Anything] = {}
        for name, form in forms.items():
            if not elements[name]:
                found[name] = None
            elif reads:
                node = builder.nodes[builder.given(name, elements[name])]
                found[name] = self._placed(builder, node, form)
            else:
                found[name] = self._placed(builder, Held(name), form)
        return Given(**found)


def _begun(recipe: Recipe, matrices: Matrices, kept: Kept, given: Given) -> Kept:
    """The belief that the command ``initialise`` makes of the state kept before and a row."""
    if recipe.start is not None:
        return recipe.start(matrices, kept, given)
    initial = matrices.model.initial
    mean = matrices.c("x0", initial.x)
    if np.any(initial.from_measurement):
        mean = mean + matrices.c("from_z", initial.from_measurement) @ given.z
    if np.any(initial.from_state):
        mean = mean + matrices.c("from_x", initial.from_state) @ kept["x"]
    if initial.from_control is not None and np.any(initial.from_control):
        mean = mean + matrices.c("from_u", initial.from_control) @ given.u
    return {"x": named(mean, "start: x"), **recipe.begin(matrices)}


def _constants(builder: Builder) -> Callable[[str, Any], Anything]:
    """What makes a constant of an array: a vector of one dimension, else a matrix."""

    def make(name: str, values: Any) -> Matrix | Vector:
        array = np.asarray(values, np.float64)
        if array.ndim == 1:
            row = builder.constant(name, array.reshape(1, -1))
            return Vector(builder, row.index, len(array))
        return builder.constant(name, array)

    return make
