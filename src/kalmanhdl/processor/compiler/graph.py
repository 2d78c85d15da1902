"""Whole matrices traced: what a filter does, as instructions whose operands are matrices.

What is known beforehand is computed beforehand: products with a unit matrix, sums with zero, anything of
constants alone. Equal instructions are one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.instructions import ACCUMULATING, Opcode

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Constant:
    """A matrix that the program reads once, before it begins."""

    name: str


@dataclass(frozen=True, slots=True)
class Held:
    """A matrix that stays from step to step."""

    name: str


@dataclass(frozen=True, slots=True)
class Read:
    """An element of a matrix that the program reads in every step."""

    name: str
    element: int


@dataclass(frozen=True, slots=True)
class Given:
    """A matrix of elements that have been read; the others are zero."""

    name: str
    reads: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Computed:
    """The result of an instruction on earlier matrices; ``immediate`` is its element or exponent.

    The last source of one that accumulates is what its destination has before, and so is the second one of a
    reciprocal and of PLACE, which leave the other elements as they are.
    """

    opcode: Opcode
    sources: tuple[int, ...]
    immediate: int = 0

    @property
    def in_place(self) -> bool:
        """Whether its last source is what its destination has before."""
        leaves_others = self.opcode in (Opcode.RECIP, Opcode.PLACE)
        return self.opcode in ACCUMULATING or (leaves_others and len(self.sources) > 1)


@dataclass(frozen=True, slots=True)
class Put:
    """An element of an earlier matrix, put out."""

    source: int
    element: int


Node = Constant | Held | Read | Given | Computed | Put


@dataclass(slots=True)
class Builder:
    """Nodes in the order of their making, and the constants among them."""

    size: int
    constants: dict[str, Array] = field(default_factory=dict)
    nodes: list[Node] = field(default_factory=list)
    comments: dict[int, str] = field(default_factory=dict)
    _places: dict[Node, int] = field(default_factory=dict)

    def place(self, node: Node) -> int:
        """The index of a node; equal ones have one."""
        if node not in self._places:
            self._places[node] = len(self.nodes)
            self.nodes.append(node)
        return self._places[node]

    def given(self, name: str, elements: Sequence[int]) -> int:
        """The index of a matrix whose elements are read, in this order."""
        reads = tuple(self.place(Read(name, element)) for element in elements)
        return self.place(Given(name, reads))

    def constant(self, name: str, values: Array) -> "Matrix":
        """A constant matrix. The name is its own: equal values under another name are another constant."""
        for known, others in self.constants.items():
            if others.shape == values.shape and np.array_equal(others, values):
                name = known
        if name in self.constants and not np.array_equal(self.constants[name], values):
            name = f"{name}_{len(self.constants)}"
        self.constants[name] = values
        return Matrix(self, self.place(Constant(name)), values.shape, values)


@dataclass(frozen=True, slots=True, eq=False)
class Vector:
    """A vector (n,), which stands in the first row of a matrix of the store."""

    builder: Builder
    index: int
    length: int

    def __add__(self, other: "Vector") -> "Vector":
        return self._with(Opcode.ADD_33, other)

    def __sub__(self, other: "Vector") -> "Vector":
        return self._with(Opcode.SUB_33, other)

    def plus(self, matrix: "Matrix", vector: "Vector") -> "Vector":
        """This and the product of a matrix and a vector, rounded once."""
        return self._accumulated(Opcode.MADD_31, Opcode.ADD_33, matrix, vector)

    def minus(self, matrix: "Matrix", vector: "Vector") -> "Vector":
        """This less the product of a matrix and a vector, rounded once."""
        return self._accumulated(Opcode.MSUB_31, Opcode.SUB_33, matrix, vector)

    def times(self, other: "Vector") -> "Vector":
        """This and another one, element by element."""
        return self._with(Opcode.HAD_33, other)

    def outer(self, other: "Vector") -> "Matrix":
        """This times the other transposed."""
        index = self.builder.place(Computed(Opcode.OUTER_33, (self.index, other.index)))
        return Matrix(self.builder, index, (self.length, other.length))

    def scaled(self, factor: "Matrix") -> "Vector":
        """Every element times element 0 of a matrix."""
        index = self.builder.place(Computed(Opcode.MULT_3S, (self.index, factor.index)))
        return Vector(self.builder, index, self.length)

    def picked(self, place: int) -> "Matrix":
        """An element alone."""
        index = self.builder.place(Computed(Opcode.PICK, (self.index,), place))
        return Matrix(self.builder, index, (1, 1))

    def as_matrix(self) -> "Matrix":
        """The same matrix of the store, for its element 0."""
        return Matrix(self.builder, self.index, (1, self.length))

    def reciprocals(self) -> "Vector":
        """1 / every element, one after the other into the same place."""
        index = self.builder.place(Computed(Opcode.RECIP, (self.index,), 0))
        for place in range(1, self.length):
            index = self.builder.place(Computed(Opcode.RECIP, (self.index, index), place))
        return Vector(self.builder, index, self.length)

    def _accumulated(self, opcode: Opcode, simple: Opcode, matrix: "Matrix", vector: "Vector") -> "Vector":
        if _unit(matrix, vector.length):
            return self._with(simple, vector)
        sources = (matrix.index, vector.index, self.index)
        return Vector(self.builder, self.builder.place(Computed(opcode, sources)), self.length)

    def _with(self, opcode: Opcode, other: "Vector") -> "Vector":
        index = self.builder.place(Computed(opcode, (self.index, other.index)))
        return Vector(self.builder, index, self.length)


@dataclass(frozen=True, slots=True, eq=False)
class Matrix:
    """A matrix (rows, columns), top left in one of the store and zero elsewhere; ``known`` if constant."""

    builder: Builder
    index: int
    shape: tuple[int, ...]
    known: Array | None = None

    @property
    def T(self) -> "Transposed":
        """Transposed; no instruction where a product can take it as it is."""
        return Transposed(self)

    def transposed(self) -> "Matrix":
        """Transposed, by an instruction."""
        if self.known is not None:
            return self.builder.constant("C", self.known.T)
        return self.alone(Opcode.TRANS_33, self.shape[::-1])

    def __add__(self, other: "Matrix") -> "Matrix":
        if self.known is not None and other.known is not None:
            return self.builder.constant("C", self.known + other.known)
        if _zero(other):
            return self
        return other if _zero(self) else self._computed(Opcode.ADD_33, (self, other), self.shape)

    def __sub__(self, other: "Matrix") -> "Matrix":
        if self.known is not None and other.known is not None:
            return self.builder.constant("C", self.known - other.known)
        return self if _zero(other) else self._computed(Opcode.SUB_33, (self, other), self.shape)

    def __matmul__(self, other: Any) -> Any:
        if isinstance(other, Vector):
            return self._on_vector(other)
        if isinstance(other, Transposed):
            return self._by_transposed(other.of)
        if self.known is not None and other.known is not None:
            return self.builder.constant("C", self.known @ other.known)
        if _unit(self, other.shape[0]):
            return other
        if _unit(other, self.shape[1]):
            return self
        return self._computed(Opcode.MULT_33, (self, other), (self.shape[0], other.shape[1]))

    def plus(self, a: "Matrix", b: "Matrix") -> "Matrix":
        """This and a b', rounded once, symmetric: the lower triangle is the mirror of the upper one."""
        if self.known is not None and a.known is not None and b.known is not None:
            return self.builder.constant("C", self.known + a.known @ b.known.T)
        if _unit(b, a.shape[1]):
            return self + a
        return self._computed(Opcode.SYMADD_33, (a, b, self), self.shape)

    def minus(self, a: "Matrix", b: "Matrix") -> "Matrix":
        """This less a b', rounded once. The difference is symmetric."""
        return self._computed(Opcode.SYMSUB_33, (a, b, self), self.shape)

    def rows_where(self, flags: "Matrix") -> "Matrix":
        """Zero in every row whose element on the diagonal of ``flags`` is zero."""
        return self._computed(Opcode.MASK_33, (self, flags), self.shape)

    def scaled(self, factor: "Matrix") -> "Matrix":
        """Every element times element 0 of another matrix."""
        return self._computed(Opcode.MULT_3S, (self, factor), self.shape)

    def elementwise(self, other: "Matrix") -> "Matrix":
        """This times another one, element by element."""
        if self.known is not None and other.known is not None:
            return self.builder.constant("C", self.known * other.known)
        return self._computed(Opcode.HAD_33, (self, other), self.shape)

    def picked(self, place: int) -> "Matrix":
        """The element of a row and column of this number, alone."""
        element = place * self.builder.size + place
        index = self.builder.place(Computed(Opcode.PICK, (self.index,), element))
        return Matrix(self.builder, index, (1, 1))

    def alone(self, opcode: Opcode, shape: tuple[int, ...]) -> "Matrix":
        """An instruction of one source."""
        return self._computed(opcode, (self,), shape)

    def _on_vector(self, vector: Vector) -> Vector:
        if _unit(self, vector.length):
            return vector
        index = self.builder.place(Computed(Opcode.MULT_31, (self.index, vector.index)))
        return Vector(self.builder, index, self.shape[0])

    def _by_transposed(self, other: "Matrix") -> "Matrix":
        if self.known is not None and other.known is not None:
            return self.builder.constant("C", self.known @ other.known.T)
        if _unit(other, self.shape[1]):
            return self
        shape = (self.shape[0], other.shape[0])
        if _unit(self, other.shape[1]):
            return other.alone(Opcode.TRANS_33, shape)
        return self._computed(Opcode.MULT_33T, (self, other), shape)

    def _computed(self, opcode: Opcode, sources: "tuple[Matrix, ...]", shape: tuple[int, ...]) -> "Matrix":
        index = self.builder.place(Computed(opcode, tuple(source.index for source in sources)))
        return Matrix(self.builder, index, shape)


@dataclass(frozen=True, slots=True, eq=False)
class Transposed:
    """A matrix transposed, on the right of a product."""

    of: Matrix


def _zero(matrix: Matrix) -> bool:
    return matrix.known is not None and not matrix.known.any()


def _unit(matrix: Matrix, rows: int) -> bool:
    known = matrix.known
    return known is not None and known.shape == (rows, rows) and np.array_equal(known, np.eye(rows))


def named(value: Any, origin: str) -> Any:
    """A matrix or a vector, its instruction with a comment that says what it is."""
    value.builder.comments.setdefault(value.index, origin)
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Instructions in order, and the nodes that the held matrices take at its end."""

    name: str
    nodes: tuple[Node, ...]
    comments: Mapping[int, str]
    held: Mapping[str, int]

    @property
    def live(self) -> tuple[int, ...]:
        """The nodes that something needs, in order. Whatever is given must be read, wanted or not."""
        needed = {*self.held.values()}
        for index in range(len(self.nodes) - 1, -1, -1):
            node = self.nodes[index]
            if isinstance(node, Read | Given | Put):
                needed.add(index)
            if index in needed:
                needed.update(sources_of(node))
        return tuple(sorted(needed))


def sources_of(node: Node) -> tuple[int, ...]:
    """The nodes that a node is made of."""
    match node:
        case Constant() | Held() | Read():
            return ()
        case Given():
            return node.reads
        case Computed():
            return node.sources
        case Put():
            return (node.source,)


def check_size(what: str, wanted: int, size: int) -> None:
    """Raises ProgramError where a model is larger than the core's matrices."""
    if wanted > size:
        raise ProgramError(
            f"{wanted} {what} do not fit the core's matrices of {size} by {size}: take a larger core"
        )
