"""Which operations take turns on one operator, and what such an operator is like.

A shared operator works on raw integers. Operands come to it shifted left, which costs nothing, so that one
operator serves operations of different formats: sums are aligned, and divisions are brought to one exponent.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.division_structure import ONE, Operand, inner, long_structure
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.product_structure import serial_rows
from kalmanhdl.graph.kinds import ITERATIVE, KINDS, kind_of, limit
from kalmanhdl.graph.operations import (
    Add,
    Constant,
    Divide,
    Multiply,
    Operation,
    Reciprocal,
    Subtract,
    SumOfProducts,
    operands,
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.wanted import refused


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """One operator and the operations, by index, that take turns on it, each for ``busy`` cycles.

    Operands are chosen in one or two ``steps``, each a cycle.
    """

    kind: str
    operations: tuple[int, ...]
    busy: int = 1
    steps: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Sharing:
    """How many operators of each kind there are, and which operations take turns on them.

    An operation takes an iterative operator for the cycles ``busy[kind]``, which lie within one interval. Any
    other operator takes one pair of operands a cycle: of a sum of products there are ``pairs``, in cycles one
    after the other that lie within one interval as well. Operands are chosen in one cycle, or in two for
    kinds in ``two_steps``. Sums of products leave their operators on ``buses``, one a cycle on each.
    """

    counts: dict[str, int]
    operations: dict[str, tuple[int, ...]]
    busy: dict[str, int] = field(default_factory=dict)
    two_steps: frozenset[str] = frozenset()
    pairs: dict[int, int] = field(default_factory=dict)
    buses: int = 0

    def kind(self) -> dict[int, str]:
        """The kind of the shared operator of each operation that has one."""
        return {index: kind for kind, found in self.operations.items() for index in found}

    @property
    def bound(self) -> int:
        """The least interval in which every operation finds its turn."""
        return max((self._turns(kind, count) for kind, count in self.counts.items()), default=1)

    def _turns(self, kind: str, count: int) -> int:
        cycles = [self.cycles(kind, index) for index in self.operations[kind]]
        if len(set(cycles)) == 1:
            return cycles[0] * ceil(len(cycles) / count)
        return max(*cycles, ceil(sum(cycles) / count))

    def cycles(self, kind: str, index: int) -> int:
        """For how many cycles an operation takes an operator of its kind."""
        return self.busy.get(kind) or self.pairs.get(index, 1)

    def steps(self, kind: str) -> int:
        """In how many cycles the operands of an operator are chosen."""
        return 2 if kind in self.two_steps else 1


NONE_SHARED = Sharing(counts={}, operations={})
"""Every operation has an operator of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Core:
    """An operator apart from its operations: the raw integers at its ports, those of its result.

    ``kept``: the result stands in registers before others choose it.
    """

    kind: str
    operands: tuple[Operand, ...]
    form: Fixed
    kept: bool = False


def sharing(
    typed: TypedGraph | FloatGraph,
    units: Mapping[str, int],
    own: Iterable[int] = (),
    iterative: Collection[str] = (),
) -> Sharing:
    """Who shares what when there are at most so many operators of a kind, some kinds being ``iterative``.

    Where there are no more operations than operators each has its own, but for iterative ones. Operations in
    ``own`` never share. Raises ScheduleError for a kind that is not known, and for operations that cannot
    share one operator.
    """
    for kind in units:
        if kind not in KINDS:
            raise refused(f"units.{kind}", f" is unknown: kinds are {', '.join(KINDS)}")
    apart = frozenset((*own, *_fused(typed)))
    alike: dict[str, list[int]] = {}
    for index, operation in enumerate(typed.graph.operations):
        word = kind_of(operation, units)
        if word is not None and index not in apart:
            alike.setdefault(word, []).append(index)
    counts = {kind: limit(kind, units) or 0 for kind in alike}
    always = {*iterative, "multiply_add"}
    shared = {kind: tuple(who) for kind, who in alike.items() if len(who) > counts[kind] or kind in always}
    for kind, who in shared.items():
        if counts[kind] < 1:
            raise refused(f"units.{kind}", f" is {counts[kind]}: use 1 or more")
        _check_alike(typed, kind, who)
    found = Sharing(
        counts={kind: min(counts[kind], len(who)) for kind, who in shared.items()},
        operations=shared,
        busy={kind: _busy(typed, kind, who) for kind, who in shared.items() if kind in iterative},
        pairs=pairs(typed.graph.operations, shared.get("multiply_add", ())),
    )
    return replace(found, buses=_buses(found))


def _buses(shared: Sharing) -> int:
    """One more than the sums of an interval need, so that few wait for one; not more than operators."""
    needed = ceil(len(shared.pairs) / shared.bound)
    return min(needed + 1, shared.counts["multiply_add"]) if shared.pairs else 0


def pairs(operations: Sequence[Operation], who: Iterable[int]) -> dict[int, int]:
    """The numbers of products of sums of products."""
    return {k: len(o.terms) for k in who if isinstance(o := operations[k], SumOfProducts)}


def _busy(typed: TypedGraph | FloatGraph, kind: str, who: tuple[int, ...]) -> int:
    """The cycles from the start of an iterative operator to the next."""
    if isinstance(typed, FloatGraph) or kind not in ITERATIVE:
        raise refused("iterative", f": there is no iterative hardware for {kind} here")
    made = core(typed, kind, who)
    if kind == "multiply":
        a, b = (port.form for port in made.operands)
        return serial_rows(a.width, a.signed, b.width, b.signed) + 1
    if kind == "reciprocal" and isinstance(typed.division, TableNewton):
        raise refused(
            "iterative", ": reciprocals by a table are not iterative: use division radix2 or radix4"
        )
    radix = typed.division.radix if isinstance(typed.division, LongDivision) else 2
    dividend, divisor = made.operands if len(made.operands) == 2 else (ONE, made.operands[0])
    rows = long_structure(dividend, divisor, inner(made.form), typed.division_rounding, radix).rows
    return ceil(rows / (radix // 2)) + 1


def _check_alike(typed: TypedGraph | FloatGraph, kind: str, who: tuple[int, ...]) -> None:
    """Reciprocals by Newton's steps share an operator when their results have equally many digits."""
    if isinstance(typed, FloatGraph) or kind != "reciprocal" or not isinstance(typed.division, TableNewton):
        return
    method = typed.division
    digits = {method.fractions(_form(typed, index)) for index in who}
    if len(digits) > 1:
        raise refused(
            f"units.{kind}",
            f": {len(who)} reciprocals of {len(digits)} precisions cannot share: "
            f"give their results one width, or allow {len(who)}",
        )


def core(typed: TypedGraph | FloatGraph, kind: str, who: tuple[int, ...]) -> Core:
    """The operator on which all these operations can take turns."""
    if isinstance(typed, FloatGraph):
        return _encoded_core(typed, kind, who)
    reads = [pair for index in who for pair in _operands_at_ports(typed, index, who)]
    ports = tuple(_union(port) for port in zip(*reads, strict=True))
    return Core(kind=kind, operands=ports, form=_result(typed, kind, who, ports))


def shifts(typed: TypedGraph | FloatGraph, index: int, who: tuple[int, ...]) -> tuple[int, ...]:
    """By how many bits what comes to each port of the operator shared by ``who`` is shifted left."""
    operation = typed.graph.operations[index]
    if isinstance(typed, FloatGraph):
        return (0,) * len(operands(operation))
    match operation:
        case Add(a, b) | Subtract(a, b):
            fraction = _form(typed, index).fraction
            return fraction - _form(typed, a).fraction, fraction - _form(typed, b).fraction
        case Divide():
            return 0, exponent(typed, who) - _exponent(typed, index)
        case Reciprocal():
            return (exponent(typed, who) - _exponent(typed, index),)
        case SumOfProducts():
            return 0, 0
        case _:
            return (0,) * len(operands(operation))


def _fused(typed: TypedGraph | FloatGraph) -> list[int]:
    """Products that are not rounded, and the sums that take them."""
    if not isinstance(typed, FloatGraph):
        return []
    sums = range(len(typed.graph.operations))
    return [*typed.fused, *(k for k in sums if typed.fused_sum(k) is not None)]


def _encoded_core(typed: FloatGraph, kind: str, who: tuple[int, ...]) -> Core:
    """An operator on encoded numbers, which are words."""
    word = Fixed(width=typed.form.width, fraction=0, signed=False)
    count = len(operands(typed.graph.operations[who[0]]))
    operand = Operand(form=word, low=0, high=word.highest)
    return Core(kind=kind, operands=(operand,) * count, form=word, kept=True)


def exponent(typed: TypedGraph, who: tuple[int, ...]) -> int:
    """The exponent of a shared division: its raw result is 2**exponent times the quotient of its raws."""
    return max(_exponent(typed, index) for index in who)


def taken(typed: TypedGraph | FloatGraph, index: int) -> tuple[tuple[int, ...], ...]:
    """The operands of an operation in the order of the ports, in each of the cycles in which it takes some.

    Of a product the narrower one, or a constant, comes last.
    """
    operation = typed.graph.operations[index]
    if isinstance(operation, SumOfProducts):
        assert isinstance(typed, TypedGraph)
        return tuple(_narrow_last(typed, (term.a, term.b)) for term in operation.terms)
    reads = operands(operation)
    if isinstance(operation, Multiply) and isinstance(typed, TypedGraph):
        reads = _narrow_last(typed, reads)
    return (reads,)


def _narrow_last(typed: TypedGraph, reads: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(sorted(reads, key=lambda k: (_is_constant(typed, k), -_form(typed, k).width)))


def _exponent(typed: TypedGraph, index: int) -> int:
    operation, fraction = typed.graph.operations[index], _form(typed, index).fraction
    match operation:
        case Divide(a, b):
            return fraction + _form(typed, b).fraction - _form(typed, a).fraction
        case Reciprocal(a):
            return fraction + _form(typed, a).fraction
        case _:
            raise AssertionError(operation)


def _operands_at_ports(typed: TypedGraph, index: int, who: tuple[int, ...]) -> list[list[Operand]]:
    """What comes to each port, cycle after cycle."""
    moved = shifts(typed, index, who)
    return [
        [_operand_at_port(typed, k, shift) for k, shift in zip(reads, moved, strict=True)]
        for reads in taken(typed, index)
    ]


def _operand_at_port(typed: TypedGraph, index: int, shift: int) -> Operand:
    interval, form = typed.intervals[index], _form(typed, index)
    assert interval is not None
    moved = Fixed(width=form.width + shift, fraction=0, signed=form.signed)
    return Operand(form=moved, low=interval.low << shift, high=interval.high << shift)


def _union(port: Iterable[Operand]) -> Operand:
    every = tuple(port)
    signed = any(one.form.signed for one in every)
    width = max(one.form.width + (signed and not one.form.signed) for one in every)
    return Operand(
        form=Fixed(width=width, fraction=0, signed=signed),
        low=min(one.low for one in every),
        high=max(one.high for one in every),
    )


def _result(typed: TypedGraph, kind: str, who: tuple[int, ...], ports: tuple[Operand, ...]) -> Fixed:
    match kind:
        case "multiply":
            signed = any(port.form.signed for port in ports)
            return Fixed(width=sum(port.form.width for port in ports), fraction=0, signed=signed)
        case "add" | "subtract":
            return Fixed(width=max(p.form.width + (not p.form.signed) for p in ports) + 1, fraction=0)
        case "multiply_add":
            return _widest(typed, who, 0)
        case _:
            return _widest(typed, who, exponent(typed, who))


def _widest(typed: TypedGraph, who: tuple[int, ...], fraction: int) -> Fixed:
    forms = [_form(typed, index) for index in who]
    signed = any(form.signed for form in forms)
    width = max(form.width + (signed and not form.signed) for form in forms)
    return Fixed(width=width, fraction=fraction, signed=signed)


def _is_constant(typed: TypedGraph, index: int) -> bool:
    return isinstance(typed.graph.operations[index], Constant)


def _form(typed: TypedGraph, index: int) -> Fixed:
    form = typed.formats[index]
    assert form is not None
    return form
