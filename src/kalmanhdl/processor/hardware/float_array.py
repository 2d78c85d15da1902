"""The array of multipliers of floating-point numbers, and the adders behind them."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

from amaranth.hdl import Cat, Const, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.data import ArrayLayout
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.float_stages import product_registers, sum_registers
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.hardware.layouts import matrix_layout, word_shape
from kalmanhdl.processor.hardware.results import Result
from kalmanhdl.processor.instructions import ACCUMULATING, OPCODE_BITS, SYMMETRIC, Opcode
from kalmanhdl.processor.timing import (
    Depth,
    Factors,
    Task,
    depth_clocks,
    depth_of,
    passes,
    passes_of,
    tasks_of_a_unit,
    uses_array,
)
from kalmanhdl.rtl.floating.adder import FloatAdder
from kalmanhdl.rtl.floating.multiplier import FloatMultiplier
from kalmanhdl.rtl.stages import delayed

Case = tuple[int, Opcode, int, tuple[Task, ...]]
"""A pass: its number on the wires, its pattern, how many passes are left with it, its tasks."""


def float_patterns(core: Core) -> dict[Opcode, tuple[Opcode, ...]]:
    """The instructions of the array that are the same but for a sign, under one of them."""
    opcodes = [each for each in Opcode if uses_array(each, core)]

    def alike(opcode: Opcode) -> tuple[str, str, bool]:
        return depth_of(opcode).value, repr(passes_of(opcode, core)), opcode in SYMMETRIC

    groups = [tuple(group) for _, group in groupby(sorted(opcodes, key=alike), key=alike)]
    return {group[0]: group for group in sorted(groups, key=lambda group: group[0].value)}


class FloatUnit(wiring.Component):
    """N multipliers, a tree of adders for their products, and one that accumulates.

    Takes factors in every clock. ``products``, sums of neighbouring ones (``pairs``, or differences where
    ``differs`` came with the factors), the sum of all and what ``base`` is with it, or without it
    (``subtracts``), stand as many clocks later as ``timing.depth_clocks`` says.
    """

    def __init__(self, core: Core) -> None:
        self._core, self._form = core, core.float_form
        word, pairs = word_shape(core), core.size // 2
        super().__init__(
            {
                "left": In(word).array(core.size),
                "right": In(word).array(core.size),
                "base": In(word),
                "differs": In(1),
                "subtracts": In(1),
                "products": Out(word).array(core.size),
                "pairs": Out(word).array(pairs),
                "total": Out(word),
                "accumulated": Out(word),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        terms: list[Value] = []
        for k, (left, right) in enumerate(zip(self.left, self.right, strict=True)):
            unit = FloatMultiplier(self._form, product_registers(self._form))
            m.submodules[f"multiplier_{k}"] = unit
            m.d.comb += [unit.a.eq(left), unit.b.eq(right)]
            terms.append(self._register(m, f"product_{k}", unit.result))
        m.d.comb += [port.eq(term) for port, term in zip(self.products, terms, strict=True)]
        differs = self._later(m, "differs", self.differs, Depth.PRODUCT)
        terms = self._level(m, 1, terms, differs)
        m.d.comb += [port.eq(term) for port, term in zip(self.pairs, terms, strict=False)]
        level = 1
        while len(terms) > 1:
            level += 1
            terms = self._level(m, level, terms, Const(0))
        (total,) = terms
        base = self._later(m, "base", self.base, Depth.SUM)
        subtracts = self._later(m, "subtracts", self.subtracts, Depth.SUM)
        m.d.comb += self.total.eq(total)
        m.d.comb += self.accumulated.eq(self._sum(m, "accumulate", base, total, subtracts))
        return m

    def _level(self, m: Module, level: int, terms: Sequence[Value], differs: Value) -> list[Value]:
        """Neighbours added; of an odd number the last one waits."""
        found: list[Value] = [
            self._sum(m, f"add_{level}_{k // 2}", terms[k], terms[k + 1], differs)
            for k in range(0, len(terms) - 1, 2)
        ]
        if len(terms) % 2:
            found.append(delayed(m, terms[-1], sum_registers(self._form) + 1, f"waits_{level}"))
        return found

    def _sum(self, m: Module, name: str, a: Value, b: Value, subtracts: Value) -> Value:
        """a + b, or a - b: b with the other sign, which NaN has not."""
        unit = FloatAdder(self._form, sum_registers(self._form))
        m.submodules[name] = unit
        m.d.comb += [unit.a.eq(a), unit.b.eq(Cat(b[:-1], b[-1] ^ subtracts))]
        return self._register(m, f"{name}_result", unit.result)

    def _register(self, m: Module, name: str, value: Value) -> Value:
        return delayed(m, value, 1, name)

    def _later(self, m: Module, name: str, value: Value, depth: Depth) -> Value:
        return delayed(m, value, depth_clocks(depth, self._core), name)


class Collector(wiring.Component):
    """Elements of one depth, in the clock in which they are found, kept until the next ones are.

    ``tag`` says which pass they come from, ``outside`` that one of them is not finite.
    """

    def __init__(self, core: Core, cases: Sequence[Case], tag_bits: int, per_unit: int) -> None:
        self._core, self._cases, self._per_unit = core, cases, per_unit
        found = word_shape(core)
        super().__init__(
            {
                "tag": In(tag_bits),
                "found": In(found).array(core.sums * per_unit),
                "result": Out(matrix_layout(core)),
                "outside": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core, form = self._core, self._core.float_form
        collected = Signal(matrix_layout(core), reset_less=True)
        kept_outside, first, outside = Signal(reset_less=True), Signal(), Signal()
        infinite = [each[form.mantissa : -1].all() for each in self.found]
        m.d.comb += [self.result[e].eq(collected[e]) for e in range(core.elements)]
        with m.Switch(self.tag):
            for value, pattern, left, tasks in self._cases:
                with m.Case(value):
                    places = [(self._place(pattern, index), task) for index, task in enumerate(tasks)]
                    for place, task in places:
                        for element in self._elements(pattern, task.element):
                            m.d.comb += self.result[element].eq(self.found[place])
                    m.d.comb += outside.eq(Cat(*(infinite[place] for place, _ in places)).any())
                    m.d.comb += first.eq(left == passes(pattern, core) or pattern is Opcode.DET_33)
        m.d.comb += self.outside.eq(outside | (kept_outside & ~first))
        m.d.sync += [collected.eq(self.result), kept_outside.eq(self.outside)]
        return m

    def _place(self, pattern: Opcode, index: int) -> int:
        """Where what a task finds stands among what all units find."""
        unit, own = divmod(index, tasks_of_a_unit(pattern, self._core))
        return unit * self._per_unit + own

    def _elements(self, pattern: Opcode, element: int) -> set[int]:
        row, column = divmod(element, self._core.size)
        mirrored = {self._core.size * column + row} if pattern in SYMMETRIC else set()
        return {element} | mirrored


class FloatArray(wiring.Component):
    """Takes an instruction's operands in the clock with ``start``; the first pass is in the next one.

    ``left`` counts the passes that are left. The ``results`` stand ``timing.behind`` and one clocks after the
    last pass. ``b`` is a matrix whatever the instruction is.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self._patterns = float_patterns(core)
        self._numbers = {pattern: number for number, pattern in enumerate(self._patterns)}
        self._most = max(passes(each, core) for each in self._patterns)
        matrix = matrix_layout(core)
        depths = {f"{name}_{depth.value}": port for depth in Depth for name, port in
                  (("result", Out(matrix)), ("outside", Out(1)))}  # fmt: skip
        super().__init__(
            {
                "start": In(1),
                "opcode": In(OPCODE_BITS),
                "a": In(matrix),
                "b": In(matrix),
                "c": In(matrix),
                "left": Out(range(self._most + 1)),
                **depths,
            }
        )

    @property
    def results(self) -> tuple[Result, ...]:
        """What it finds for which instructions."""
        return tuple(
            Result(
                opcodes=tuple(each for each in Opcode if self._is_of(each, depth)),
                elements=dict(enumerate(getattr(self, f"result_{depth.value}"))),
                outside=getattr(self, f"outside_{depth.value}"),
            )
            for depth in Depth
        )

    def _is_of(self, opcode: Opcode, depth: Depth) -> bool:
        return uses_array(opcode, self._core) and depth_of(opcode) is depth

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core, matrix = self._core, matrix_layout(self._core)
        a, b, c = (Signal(matrix, name=f"operand_{name}", reset_less=True) for name in "abc")
        pattern, subtracts = Signal(range(len(self._patterns))), Signal()
        with m.If(self.left != 0):
            m.d.sync += self.left.eq(self.left - 1)
        with m.If(self.start):
            m.d.sync += [a.eq(self.a), b.eq(self.b), c.eq(self.c)]
            m.d.sync += subtracts.eq(is_one_of(self.opcode, core, (Opcode.SYMSUB_33, Opcode.MSUB_31)))
            for each, alike in self._patterns.items():
                with m.If(is_one_of(self.opcode, core, alike)):
                    m.d.sync += [pattern.eq(self._numbers[each]), self.left.eq(passes(each, core))]
        # What is left of an instruction and its pattern together say what every unit does.
        now = Cat(self.left, pattern)
        cofactors = Signal(ArrayLayout(word_shape(core), core.size), reset_less=True)
        sources = {Factors.A: a, Factors.B: b, Factors.COFACTORS: cofactors}
        units = [self._unit(m, unit, now, sources, c, subtracts) for unit in range(core.sums)]
        tags = {0: Signal.like(now, name="tag")}
        m.d.sync += tags[0].eq(now)
        for clock in range(1, depth_clocks(Depth.ACCUMULATED, core) + 1):
            tags[clock] = Signal.like(now, name=f"tag_{clock}")
            m.d.sync += tags[clock].eq(tags[clock - 1])
        for depth in Depth:
            self._collect(m, depth, tags[depth_clocks(depth, core)], units)
        if core.has(Opcode.DET_33):
            self._keep_cofactors(m, tags[depth_clocks(Depth.PAIR, core)], units, cofactors)
        return m

    def _cases(self) -> Iterator[Case]:
        bits = self._most.bit_length()
        for each, number in self._numbers.items():
            all_passes = passes_of(each, self._core)
            for index, tasks in enumerate(all_passes):
                left = len(all_passes) - index
                yield number << bits | left, each, left, tasks

    def _own(self, pattern: Opcode, tasks: Sequence[Task], unit: int) -> Sequence[Task]:
        """The tasks of a unit in a pass."""
        each = tasks_of_a_unit(pattern, self._core)
        return tasks[each * unit : each * (unit + 1)]

    def _unit(
        self,
        m: Module,
        number: int,
        now: Value,
        sources: Mapping[Factors, Signal],
        c: Signal,
        subtracts: Value,
    ) -> FloatUnit:
        """A unit, with what it takes in every pass, a clock later."""
        core, word = self._core, word_shape(self._core)
        m.submodules[f"unit_{number}"] = unit = FloatUnit(core)
        left, right = (
            [Signal(word, name=f"{side}_{number}_{k}") for k in range(core.size)]
            for side in ("left", "right")
        )
        kept, differs = Signal(word, name=f"kept_{number}"), Signal(name=f"differs_{number}")
        with m.Switch(now):
            for value, pattern, _, tasks in self._cases():
                own = self._own(pattern, tasks, number)
                if own:
                    with m.Case(value):
                        terms = [term for task in own for term in task.terms]
                        for k, term in enumerate(terms):
                            m.d.comb += left[k].eq(self._factor(sources, term.of[0], term.left))
                            m.d.comb += right[k].eq(self._factor(sources, term.of[1], term.right))
                        m.d.comb += differs.eq(own[0].differs)
                        if pattern in ACCUMULATING:
                            m.d.comb += kept.eq(c[own[0].element])
        for ports, values, name in ((unit.left, left, "factor_left"), (unit.right, right, "factor_right")):
            for k, (port, value) in enumerate(zip(ports, values, strict=True)):
                m.d.comb += port.eq(delayed(m, value, 1, f"{name}_{number}_{k}"))
        m.d.comb += [
            unit.base.eq(delayed(m, kept, 1, f"base_{number}")),
            unit.differs.eq(delayed(m, differs, 1, f"differing_{number}")),
            unit.subtracts.eq(delayed(m, subtracts, 1, f"subtracting_{number}")),
        ]
        return unit

    def _factor(self, sources: Mapping[Factors, Signal], of: Factors, place: int) -> Value:
        if of is Factors.ONE:
            return Const(self._core.numbers.nearest(1.0), word_shape(self._core))
        factor: Value = sources[of][place]
        return factor

    def _collect(self, m: Module, depth: Depth, tag: Value, units: Sequence[FloatUnit]) -> None:
        core = self._core
        cases = [
            (value, pattern, left, results)
            for value, pattern, left, tasks in self._cases()
            if depth_of(pattern) is depth and (results := tuple(task for task in tasks if not task.cofactor))
        ]
        found = [_found(unit, depth) for unit in units]
        name = f"collect_{depth.value}"
        m.submodules[name] = collector = Collector(core, cases, len(tag), len(found[0]))
        m.d.comb += collector.tag.eq(tag)
        flat = [value for each in found for value in each]
        m.d.comb += [port.eq(value) for port, value in zip(collector.found, flat, strict=True)]
        m.d.comb += [
            getattr(self, f"result_{depth.value}").eq(collector.result),
            getattr(self, f"outside_{depth.value}").eq(collector.outside),
        ]

    def _keep_cofactors(self, m: Module, tag: Value, units: Sequence[FloatUnit], cofactors: Signal) -> None:
        """Those of the first row, for the pass that multiplies them with it."""
        with m.Switch(tag):
            for value, pattern, _, tasks in self._cases():
                found = [
                    (pair, task)
                    for number, unit in enumerate(units)
                    for pair, task in zip(unit.pairs, self._own(pattern, tasks, number), strict=False)
                    if task.cofactor
                ]
                if found:
                    with m.Case(value):
                        m.d.sync += [cofactors[task.element].eq(pair) for pair, task in found]


def _found(unit: FloatUnit, depth: Depth) -> list[Value]:
    """What a unit finds at a depth."""
    match depth:
        case Depth.PRODUCT:
            return list(unit.products)
        case Depth.PAIR:
            return list(unit.pairs)
        case Depth.SUM:
            return [unit.total]
        case Depth.ACCUMULATED:
            return [unit.accumulated]
