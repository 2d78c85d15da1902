"""Values that travel along with a step from cycle to cycle."""

from amaranth import Const, Module, Signal, Value
from amaranth.lib.memory import Memory


class Phases:
    """The cycles of an interval, counted: what repeats with every interval is told by them.

    Cycle 0 of every step falls on phase 0. ``turn`` counts intervals, as far as it has bits.
    """

    def __init__(self, m: Module, interval: int, turns: int = 1) -> None:
        self._m, self.interval = m, interval
        self._active: dict[int, Value] = {}
        self._fields: list[tuple[Signal, list[int]]] = []
        self.turn = Signal(range(turns), name="turn") if turns > 1 else Const(0, 0)
        if interval == 1:
            self._next: Value = Const(0, 1)
            if turns > 1:
                m.d.sync += self.turn.eq(self.turn + 1)
            return
        # The first step enters in the second clock after reset.
        phase = Signal(range(interval), init=interval - 1, name="phase")
        self._next = Signal(range(interval), name="next_phase")
        last = phase == interval - 1
        m.d.comb += self._next.eq(phase + 1)
        with m.If(last):
            m.d.comb += self._next.eq(0)
            if turns > 1:
                m.d.sync += self.turn.eq(self.turn + 1)
        m.d.sync += phase.eq(self._next)

    def active(self, cycle: int) -> Value:
        """High in the clocks in which a step can be in a cycle."""
        if self.interval == 1:
            return Const(1, 1)
        phase = cycle % self.interval
        if phase not in self._active:
            active = Signal(name=f"in_phase_{phase}")
            self._m.d.sync += active.eq(self._next == phase)
            self._active[phase] = active
        return self._active[phase]

    def table(self, name: str, words: list[int], width: int) -> Value:
        """The word of the phase, from the control store; a constant where it is always the same."""
        assert len(words) == self.interval
        if width == 0 or len(set(words)) == 1:
            return Const(words[0], width)
        field = Signal(width, name=name)
        self._fields.append((field, words))
        return field

    def finish(self) -> None:
        """Build the control store of all tables."""
        if not self._fields:
            return
        rows = [0] * self.interval
        offset = 0
        for field, words in self._fields:
            rows = [row | word << offset for row, word in zip(rows, words, strict=True)]
            offset += len(field)
        # A block RAM is slow to give what it reads: each word is read a clock early, and stands in registers.
        store = Memory(shape=offset, depth=self.interval, init=rows[1:] + rows[:1])
        self._m.submodules.control_store = store
        port = store.read_port()
        word = Signal(offset, name="control_word", reset_less=True)
        self._m.d.comb += port.addr.eq(self._next)
        self._m.d.sync += word.eq(port.data)
        offset = 0
        for field, _ in self._fields:
            self._m.d.comb += field.eq(word[offset : offset + len(field)])
            offset += len(field)


class Timeline:
    """A value and its copies in later cycles; each copy is one register, made when first asked for.

    A copy is taken once an interval and stands as long. Copies are named ``<name>_c<cycle>`` by the first
    cycle in which they stand. The value itself stands until the cycle ``last``. With ``reset`` copies are
    cleared by reset, as valid bits must be.
    """

    def __init__(
        self,
        m: Module,
        phases: Phases,
        name: str,
        value: Value,
        cycle: int,
        *,
        last: int | None = None,
        reset: bool = False,
    ) -> None:
        self._m = m
        self._phases = phases
        self._name = name
        self._cycle = cycle
        self._last = cycle if last is None else last
        self._reset = reset
        self._copies = [value]

    @classmethod
    def computed(
        cls, m: Module, phases: Phases, name: str, value: Value, shape: object, cycle: int
    ) -> "Timeline":
        """A timeline that begins with a named signal for a value computed in a cycle."""
        signal = Signal(shape, name=f"{name}_c{cycle}")
        m.d.comb += signal.eq(value)
        return cls(m, phases, name, signal, cycle)

    def at(self, cycle: int) -> Value:
        """The value that belongs to a step, as it stands in a cycle of the step."""
        assert cycle >= self._cycle, f"{self._name} is there in cycle {self._cycle}, not in {cycle}"
        if cycle <= self._last:
            return self._copies[0]
        interval = self._phases.interval
        number = -(-(cycle - self._cycle) // interval)
        while len(self._copies) <= number:
            last = self._copies[-1]
            first = self._cycle + (len(self._copies) - 1) * interval + 1
            copy = Signal(last.shape(), name=f"{self._name}_c{first}", reset_less=not self._reset)
            if interval == 1:
                self._m.d.sync += copy.eq(last)
            else:
                with self._m.If(self._phases.active(self._cycle)):
                    self._m.d.sync += copy.eq(last)
            self._copies.append(copy)
        return self._copies[number]


class Always:
    """A constant: there in every cycle, without registers."""

    def __init__(self, value: Value) -> None:
        self._value = value

    def at(self, cycle: int) -> Value:
        """The constant."""
        return self._value
