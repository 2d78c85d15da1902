"""The operands of shared operators: chosen by phase among registers, constants and small memories."""

from math import ceil, sqrt

from amaranth.hdl import Cat, Module, Signal, Value
from amaranth.lib.memory import Memory

from kalmanhdl.graph.operations import Constant, Subtract, SumOfProducts
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.choice import chosen
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.shared_unit import SharedUnit
from kalmanhdl.rtl.timeline import Phases
from kalmanhdl.rtl.values import Values
from kalmanhdl.schedule.accumulator import finer, mode
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.results import Own, source
from kalmanhdl.schedule.storage import File, Port, Read


def take_turns(m: Module, phases: Phases, values: Values, unit: SharedUnit, name: str) -> None:
    """Bring the operands of every turn to the ports of a shared operator."""
    plan, later = values.plan, unit.unit.steps - 1
    for number, port in enumerate(unit.choices):
        operand = _Operand(m, phases, values, f"{name}_operand_{number}", getattr(unit, f"operand_{number}"))
        operand.connect(port, unit.unit.steps)
    if unit.unit.busy > 1:
        words = [0] * plan.interval
        for index in unit.unit.operations:
            words[(plan.start[index] + later) % plan.interval] = 1
        m.d.comb += unit.start.eq(phases.table(f"{name}_start", words, 1))
    if unit.kind == "multiply_add":
        _sum_products(m, phases, values, unit, name)
    if "subtract" in unit.signature.members:
        words = [0] * plan.interval
        for index in unit.unit.operations:
            operation = plan.typed.graph.operations[index]
            words[(plan.start[index] + later) % plan.interval] = int(isinstance(operation, Subtract))
        m.d.comb += unit.subtract.eq(phases.table(f"{name}_subtract", words, 1))


def _sum_products(m: Module, phases: Phases, values: Values, unit: SharedUnit, name: str) -> None:
    """What becomes of each product in the cycle in which it is added, and of each sum in the next."""
    plan, typed = values.plan, values.plan.typed
    assert isinstance(typed, TypedGraph)
    first, negative, place, modes = ([0] * plan.interval for _ in range(4))
    for index in unit.unit.operations:
        operation = typed.graph.operations[index]
        assert isinstance(operation, SumOfProducts)
        added = plan.start[index] + unit.added_after
        first[added % plan.interval] = 1
        for cycle, term in enumerate(operation.terms, start=added):
            negative[cycle % plan.interval] = int(term.negative)
            place[cycle % plan.interval] = unit.sums.dropped - finer(typed, operation, term)
        last = (added + len(operation.terms)) % plan.interval
        modes[last] = unit.sums.modes.index(mode(operation))
    for field, words in (("first", first), ("negative", negative), ("place", place), ("mode", modes)):
        port = getattr(unit, field)
        m.d.comb += port.eq(phases.table(f"{name}_{field}", words, len(port)))


class _Operand:
    """One operand port of a shared operator, and everything in front of it."""

    def __init__(self, m: Module, phases: Phases, values: Values, name: str, operand: Signal) -> None:
        self._m, self._phases, self._values, self._name = m, phases, values, name
        self._operand = operand
        self._plan: Plan = values.plan

    def connect(self, port: Port, steps: int) -> None:
        """Drive the port with the operand of the phase, or with that of the phase before."""
        sources: list[Value] = []
        place: dict[object, int] = {}
        words = [0] * self._plan.interval

        def choose(read: Read, key: object, source: Value) -> None:
            if key not in place:
                place[key] = len(sources)
                sources.append(source)
            words[read.cycle % self._plan.interval] = place[key]

        files = [self._file(number, file, port) for number, file in enumerate(port.files)]
        constants = self._constants(port)
        for read in port.reads:
            if isinstance(self._plan.typed.graph.operations[read.value], Constant):
                choose(read, "constant", constants)
            elif read.file is not None:
                choose(read, read.file, files[read.file])
            else:
                key, value = self._standing(read)
                choose(read, (key, read.shift), self._fitted(value.shift_left(read.shift)))
        if steps == 2:
            words, sources = self._first_step(words, sources)
        select = self._phases.table(f"{self._name}_select", words, (len(sources) - 1).bit_length())
        self._m.d.comb += self._operand.eq(self._selected(select, sources))

    def _standing(self, read: Read) -> tuple[object, Value]:
        """What has the value in the cycle: the wire on which it comes, of others too, or a register."""
        wire = self._values.wires.of(read.value)
        if read.cycle == self._plan.end(read.value) and not isinstance(wire, Own):
            return source(wire), self._values.result(read.value)
        register = self._values.at(read.value, read.cycle)
        return id(register), register

    def _first_step(self, words: list[int], sources: list[Value]) -> tuple[list[int], list[Value]]:
        """One source of each of a few groups, in registers, and which group is the one a clock later."""
        size, interval = ceil(sqrt(len(sources))), len(words)
        groups = [sources[first : first + size] for first in range(0, len(sources), size)]
        registers: list[Value] = []
        for number, group in enumerate(groups):
            name = f"{self._name}_group_{number}"
            places = [word % size if word // size == number else 0 for word in words]
            select = self._phases.table(f"{name}_select", places, (len(group) - 1).bit_length())
            register = Signal.like(self._operand, name=name, reset_less=True)
            self._m.d.sync += register.eq(self._selected(select, group, name))
            registers.append(register)
        return [words[phase - 1] // size for phase in range(interval)], registers

    def _fitted(self, value: Value) -> Value:
        shape = self._operand.shape()
        return fitted(value, shape.width, shape.signed)

    def _constants(self, port: Port) -> Value:
        """The constant of the phase, from the control store."""
        words, width = [0] * self._plan.interval, self._operand.shape().width
        for read in port.reads:
            operation, form = (
                self._plan.typed.graph.operations[read.value],
                self._plan.typed.formats[read.value],
            )
            if isinstance(operation, Constant):
                assert form is not None
                raw = form.nearest(operation.value) << read.shift
                words[read.cycle % self._plan.interval] = raw & ((1 << width) - 1)
        return self._phases.table(f"{self._name}_constant", words, width)

    def _selected(self, select: Value, sources: list[Value], name: str = "") -> Value:
        return chosen(self._m, name or self._name, select, sources, self._operand.shape())

    def _file(self, number: int, file: File, port: Port) -> Value:
        """A memory that keeps values until their turn; its value of the phase."""
        interval, name = self._plan.interval, f"{self._name}_file_{number}"
        sources: list[Value] = []
        place: dict[object, int] = {}
        enable, chosen_from, write, written = ([0] * interval for _ in range(4))
        for entry in file.entries:
            phase = entry.written % interval
            value, *_ = entry.values
            key = source(self._values.wires.of(value)), entry.shift
            if key not in place:
                place[key] = len(sources)
                sources.append(self._fitted(self._values.result(value).shift_left(entry.shift)))
            enable[phase], chosen_from[phase], write[phase] = 1, place[key], entry.slot
            written[phase] = entry.written // interval % file.turns
        read, since = [0] * interval, [0] * interval
        slot = {(value, entry.shift): entry.slot for value, entry in file.kept}
        for each in port.reads:
            if each.file == number:
                phase = each.cycle % interval
                read[phase], since[phase] = slot[each.value, each.shift], each.cycle // interval % file.turns
        memory = Memory(shape=self._operand.shape().width, depth=file.slots * file.turns, init=[])
        self._m.submodules[name] = memory
        into, out = memory.write_port(), memory.read_port(domain="comb")
        table, bits = self._phases.table, (len(sources) - 1).bit_length()
        written_value = self._selected(table(f"{name}_source", chosen_from, bits), sources)
        self._m.d.comb += [
            into.en.eq(table(f"{name}_enable", enable, 1)),
            into.data.eq(written_value),
            into.addr.eq(self._address(file, f"{name}_write", write, written)),
            out.addr.eq(self._address(file, f"{name}_read", read, since)),
        ]
        waiting = Signal.like(self._operand, name=f"{name}_value")
        self._m.d.comb += waiting.eq(out.data)
        return waiting

    def _address(self, file: File, name: str, slots: list[int], turns: list[int]) -> Value:
        """The slot of the phase, in the place of the step that began so many intervals ago."""
        slot = self._phases.table(f"{name}_slot", slots, (file.slots - 1).bit_length())
        if file.turns == 1:
            return slot
        bits = (file.turns - 1).bit_length()
        ago = self._phases.table(f"{name}_ago", turns, bits)
        return Cat((self._phases.turn[:bits] - ago)[:bits], slot)
