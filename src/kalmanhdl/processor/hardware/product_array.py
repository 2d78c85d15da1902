"""The array of multipliers of a pipelined core: sums of products, so many elements of a result in a clock."""

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

from amaranth.hdl import Cat, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.data import ArrayLayout
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.alu import register
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.hardware.layouts import matrix_layout
from kalmanhdl.processor.hardware.results import Result
from kalmanhdl.processor.instructions import ACCUMULATING, OPCODE_BITS, SYMMETRIC, VECTORS, Opcode
from kalmanhdl.processor.timing import SPLIT, Factors, Task, passes, passes_of, uses_array
from kalmanhdl.rtl.quantiser import quantised


def patterns(core: Core) -> dict[Opcode, tuple[Opcode, ...]]:
    """The instructions of the array that have the same tasks, under one of them."""
    minors = tuple((each,) for each in (Opcode.ADJ_33, Opcode.DET_33) if core.has(each))
    matrices = (Opcode.MULT_33, Opcode.MULT_33T)
    scaled = (Opcode.MULT_3S, Opcode.SCALE)
    sums = (tuple(sorted(SYMMETRIC, key=lambda each: each.value)),) if core.extended else ()
    elements = ((Opcode.HAD_33,), (Opcode.OUTER_33,)) if core.extended else ()
    vectors = tuple(sorted(VECTORS, key=lambda each: each.value))
    return {each[0]: each for each in (vectors, matrices, scaled, *sums, *elements, *minors)}


@dataclass(frozen=True, slots=True)
class _Unit:
    """What a unit has in the clock behind a pass: its products, their sum, and that with what it goes to."""

    products: list[Value]
    total: Value
    exact: Value


class ProductArray(wiring.Component):
    """Takes an instruction's operands in the clock with ``start``; the first pass is in the next one.

    ``left`` counts the passes that are left. The ``result`` stands in the clock behind the last pass, with
    ``outside``: an element did not fit; the ``determinant`` two clocks later. ``b`` is a matrix whatever the
    instruction is. A unit sums the products of a task: ``timing.passes_of`` says which, when.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self._patterns = patterns(core)
        self._numbers = {pattern: number for number, pattern in enumerate(self._patterns)}
        self._most = max(passes(each, core) for each in self._patterns)
        self.sum_width = 2 * core.fixed_form.width + (core.size - 1).bit_length() + 1
        matrix = matrix_layout(core)
        super().__init__(
            {
                "start": In(1),
                "opcode": In(OPCODE_BITS),
                "a": In(matrix),
                "b": In(matrix),
                "c": In(matrix),
                "left": Out(range(self._most + 1)),
                "result": Out(matrix),
                "outside": Out(1),
                "determinant": Out(signed(core.fixed_form.width)),
                "determinant_outside": Out(1),
            }
        )

    @property
    def results(self) -> tuple[Result, ...]:
        """What it finds for which instructions."""
        core = self._core
        sums = tuple(each for each in Opcode if each is not Opcode.DET_33 and uses_array(each, core))
        found = Result(opcodes=sums, elements=dict(enumerate(self.result)), outside=self.outside)
        determinant = Result(
            opcodes=(Opcode.DET_33,),
            elements={0: self.determinant},
            outside=self.determinant_outside,
        )
        return (found, determinant)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = self._core
        matrix = matrix_layout(core)
        a, b, c = (Signal(matrix, name=f"operand_{name}", reset_less=True) for name in "abc")
        pattern = Signal(range(len(self._patterns)))
        subtracts = Signal()
        with m.If(self.left != 0):
            m.d.sync += self.left.eq(self.left - 1)
        with m.If(self.start):
            m.d.sync += [a.eq(self.a), b.eq(self.b)]
            accumulates = is_one_of(self.opcode, core, ACCUMULATING)
            m.d.sync += [c[e].eq(Mux(accumulates, self.c[e], 0)) for e in range(core.elements)]
            m.d.sync += subtracts.eq(is_one_of(self.opcode, core, (Opcode.SYMSUB_33, Opcode.MSUB_31)))
            for each, alike in self._patterns.items():
                with m.If(is_one_of(self.opcode, core, alike)):
                    m.d.sync += [pattern.eq(self._numbers[each]), self.left.eq(passes(each, core))]
        # Together they say what every unit does.
        now = Cat(self.left, pattern)
        then = Signal.like(now, name="stored_pass")
        subtracted = Signal()
        m.d.sync += [then.eq(now), subtracted.eq(subtracts)]
        minor = self._where(m, then, "minor", {Opcode.ADJ_33, Opcode.DET_33})
        split = self._where(m, then, "split", SPLIT)
        units = [self._unit(m, unit, now, (a, b, c), minor, subtracted) for unit in range(core.units)]
        self._collect(m, then, [self._found(split, unit) for unit in units])
        if core.has(Opcode.DET_33):
            self._determinant(m, then, [unit.total for unit in units], a)
        return m

    def _cases(self) -> Iterator[tuple[int, Opcode, int, tuple[Task, ...]]]:
        """Every pass of every pattern: its number on the wires, its pattern, how many are left, its tasks."""
        bits = self._most.bit_length()
        for each, number in self._numbers.items():
            all_passes = passes_of(each, self._core)
            for index, tasks in enumerate(all_passes):
                left = len(all_passes) - index
                yield number << bits | left, each, left, tasks

    def _unit(
        self,
        m: Module,
        unit: int,
        now: Value,
        operands: Sequence[Signal],
        minor: Value,
        subtracted: Value,
    ) -> _Unit:
        a, b, c = operands
        core = self._core
        word = signed(core.fixed_form.width)
        factors = [
            (Signal(word, name=f"left_{unit}_{k}"), Signal(word, name=f"right_{unit}_{k}"))
            for k in range(core.size)
        ]
        kept = Signal(word, name=f"kept_{unit}")
        with m.Switch(now):
            for value, pattern, _, tasks in self._cases():
                own = self._own(pattern, tasks, unit)
                if own:
                    with m.Case(value):
                        terms = [term for task in own for term in task.terms]
                        for (left, right), term in zip(factors, terms, strict=False):
                            source = a if term.of[1] is Factors.A else b
                            m.d.comb += [left.eq(a[term.left]), right.eq(source[term.right])]
                        m.d.comb += kept.eq(c[own[0].element])
        products = [
            register(m, f"product_{unit}_{k}", left * right) for k, (left, right) in enumerate(factors)
        ]
        second = Mux(minor, -products[1], products[1])
        total = sum(products[2:], start=products[0] + second)
        exact = Signal(signed(self.sum_width), name=f"exact_{unit}")
        base = register(m, f"base_{unit}", kept).shift_left(core.fixed_form.fraction)
        m.d.comb += exact.eq(Mux(subtracted, base - total, base + total))
        return _Unit(products, total, exact)

    def _own(self, pattern: Opcode, tasks: Sequence[Task], unit: int) -> Sequence[Task]:
        """The tasks of a unit in a pass."""
        each = self._core.size if pattern in SPLIT else 1
        return tasks[each * unit : each * (unit + 1)]

    def _where(self, m: Module, then: Value, name: str, alike: Container[Opcode]) -> Signal:
        """Whether the pass is that of some patterns."""
        found = Signal(name=name)
        with m.Switch(then):
            for value, pattern, _, _ in self._cases():
                if pattern in alike:
                    with m.Case(value):
                        m.d.comb += found.eq(1)
        return found

    def _found(self, split: Value, unit: _Unit) -> list[tuple[Value, Value]]:
        """The numbers that a unit finds, with their flags: its sum, or each of its products."""
        core = self._core
        exact = [Mux(split, unit.products[0], unit.exact), *unit.products[1:]]
        fraction = 2 * core.fixed_form.fraction
        return [quantised(each, fraction, core.fixed_form, core.rounding, core.overflow) for each in exact]

    def _collect(self, m: Module, then: Value, found: Sequence[Sequence[tuple[Value, Value]]]) -> None:
        """Elements in the clock in which they are found, kept until the last ones are."""
        core = self._core
        collected = Signal(matrix_layout(core), reset_less=True)
        kept_outside, first = Signal(reset_less=True), Signal()
        outside = Signal()
        m.d.comb += [self.result[e].eq(collected[e]) for e in range(core.elements)]
        with m.Switch(then):
            for value, pattern, left, tasks in self._cases():
                with m.Case(value):
                    flags = []
                    for unit, numbers in enumerate(found):
                        own = self._own(pattern, tasks, unit)
                        for (number, flag), task in zip(numbers, own, strict=False):
                            places = self._places(pattern, task.element)
                            m.d.comb += [self.result[e].eq(number) for e in places]
                            flags.append(flag)
                    m.d.comb += outside.eq(Cat(*flags).any())
                    m.d.comb += first.eq(left == passes(pattern, core))
        m.d.comb += self.outside.eq(outside | (kept_outside & ~first))
        m.d.sync += [collected.eq(self.result), kept_outside.eq(self.outside)]

    def _places(self, pattern: Opcode, element: int) -> set[int]:
        row, column = divmod(element, self._core.size)
        mirrored = {self._core.size * column + row} if pattern in SYMMETRIC else set()
        return {element} | mirrored

    def _determinant(self, m: Module, then: Value, totals: Sequence[Value], a: Signal) -> None:
        """The first row times its cofactors, on multipliers of its own."""
        core = self._core
        cofactors = Signal(ArrayLayout(signed(2 * core.fixed_form.width + 1), 3), reset_less=True)
        with m.Switch(then):
            for value, pattern, _, tasks in self._cases():
                if pattern is Opcode.DET_33:
                    with m.Case(value):
                        for total, task in zip(totals, tasks, strict=False):
                            m.d.sync += cofactors[task.element].eq(total)
        # The row goes along with the products: the array may have its next operands by then.
        terms = [
            register(m, f"term_{k}", register(m, f"row_{k}", register(m, f"first_{k}", a[k])) * cofactors[k])
            for k in range(3)
        ]
        total = terms[0] + terms[1] + terms[2]
        value, outside = quantised(
            total, 3 * core.fixed_form.fraction, core.fixed_form, core.rounding, core.overflow
        )
        m.d.comb += [self.determinant.eq(value), self.determinant_outside.eq(outside)]
