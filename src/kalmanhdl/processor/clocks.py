"""When instructions take effect: the eight clocks of the paper, or overlapping ones."""

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import Instruction, Opcode
from kalmanhdl.processor.peripherals import Sink, Source
from kalmanhdl.processor.timing import (
    FRONT_CLOCKS,
    JUMP_CLOCKS,
    QUEUE,
    clocks_of_instruction,
    latency,
    passes,
    sources,
)


@dataclass(frozen=True, slots=True)
class Retired:
    """An instruction in the clock in which it takes effect.

    ``clock`` counts from the first clock in which the core runs. ``values`` go to the elements ``elements``
    of the matrix ``matrix``, which had ``before``. ``saturated``: a result did not fit the format. ``sent``:
    what a WRITE puts out. ``jumped``: what follows is not the next address.
    """

    clock: int
    address: int
    instruction: Instruction
    matrix: int = 0
    elements: range = range(0)
    values: tuple[int, ...] = ()
    before: tuple[int, ...] = ()
    saturated: bool = False
    sent: int | None = None
    jumped: bool = False


@dataclass(frozen=True, slots=True)
class Seen:
    """What an instruction sees: the signals of the conditional jumps, and the number that READ would get."""

    input_ready: bool
    output_taken: bool
    data_in: int


@dataclass(frozen=True, slots=True)
class Event:
    """A clock in which an instruction takes effect or a result is stored, before its end.

    ``flags``: ACK_I, DRDY_O, DRDY_I, ACK_O, saturated. ``issued`` takes effect, ``stored`` writes its result.
    """

    clock: int
    flags: tuple[bool, bool, bool, bool, bool]
    data_out: int
    issued: Retired | None
    stored: Retired | None


class Clocks(Protocol):
    """A core's time, with its handshakes. ``events`` is kept by whoever wants to see them."""

    clock: int
    events: list[Event] | None

    def reset(self) -> list[Retired]:
        """A reset, which loses the results that are given back, last first."""

    def exhausted(self, source: Source) -> bool:
        """Whether nothing more will ever be read."""

    def reach(self, instruction: Instruction, source: Source, sink: Sink) -> bool:
        """Live up to the clock in which the instruction takes effect; whether there is one."""

    def seen(self, source: Source) -> Seen:
        """What the instruction sees in that clock."""

    def leave(self, done: Retired, source: Source, sink: Sink) -> None:
        """Live through that clock."""


@dataclass(slots=True)
class EightClocks:
    """Every instruction takes eight clocks, and effect in the last of them; the jumps look in the seventh.

    FUNC takes eight as often as it needs.
    """

    core: Core
    clock: int = 0
    events: list[Event] | None = None
    acknowledge: bool = False
    ready: bool = False
    data_out: int = 0
    saturated: bool = False
    _waited_for: tuple[bool, bool] = (False, False)
    _began: int = 0

    def reset(self) -> list[Retired]:
        """Nothing is ever on its way."""
        self.clock = self.data_out = self._began = 0
        self.acknowledge = self.ready = self.saturated = False
        return []

    def exhausted(self, source: Source) -> bool:
        """The lines themselves are read."""
        return source.exhausted

    def reach(self, instruction: Instruction, source: Source, sink: Sink) -> bool:
        """Up to its last clock."""
        left = self._began + clocks_of_instruction(instruction.opcode, self.core) - 1 - self.clock
        if left:
            self._pass(left - 1, source, sink)
            self._waited_for = source.ready, sink.taken
            self._pass(1, source, sink)
        return True

    def seen(self, source: Source) -> Seen:
        """The signals of the clock before, the number of this one."""
        return Seen(*self._waited_for, source.data)

    def leave(self, done: Retired, source: Source, sink: Sink) -> None:
        """The eighth clock; the strobes move with the instruction."""
        if self.events is not None:
            flags = (self.acknowledge, self.ready, source.ready, sink.taken, self.saturated)
            self.events.append(Event(done.clock, flags, self.data_out, done, done if done.elements else None))
        self._pass(1, source, sink)
        self._began = self.clock
        self.saturated |= done.saturated
        match done.instruction.opcode:
            case Opcode.READ:
                self.acknowledge = True
                source.read()
            case Opcode.JUMP_DRDY:
                self.acknowledge = False
            case Opcode.JUMP_ACK:
                self.ready = False
            case Opcode.WRITE:
                assert done.sent is not None
                self.ready, self.data_out = True, done.sent
            case _:
                pass

    def _pass(self, clocks: int, source: Source, sink: Sink) -> None:
        source.advance(self.acknowledge, clocks)
        sink.advance(self.ready, clocks)
        self.clock += clocks


@dataclass(slots=True)
class Overlapping:
    """An instruction a clock, in order, unless it must wait: ``timing.py`` says how long each takes.

    It waits for the matrices that it reads until they are stored, for the array of multipliers, for the one
    way into the store, for an earlier result of its own destination, READ for a number in the queue, WRITE
    for room in the other one. The queues take and give by the handshakes on their own.
    """

    core: Core
    clock: int = 0
    events: list[Event] | None = None
    acknowledge: bool = False
    ready: bool = False
    data_out: int = 0
    saturated: bool = False
    _earliest: int = FRONT_CLOCKS
    _array_free: int = 0
    _pending: list[tuple[int, Retired]] = field(default_factory=list)
    _coming: deque[int] = field(default_factory=deque)
    _going: deque[int] = field(default_factory=deque)
    _written: int | None = None

    def reset(self) -> list[Retired]:
        """What has not been stored by now never is."""
        lost = [done for clock, done in reversed(self._pending) if clock >= self.clock]
        self.clock = self.data_out = self._array_free = 0
        self._earliest = FRONT_CLOCKS
        self.acknowledge = self.ready = self.saturated = False
        for queue in (self._pending, self._coming, self._going):
            queue.clear()
        self._written = None
        return lost

    def exhausted(self, source: Source) -> bool:
        """Nothing waits in the queue either."""
        return source.exhausted and not self._coming

    def reach(self, instruction: Instruction, source: Source, sink: Sink) -> bool:
        """Up to the clock in which it issues."""
        while not self._issues(instruction):
            if instruction.opcode is Opcode.READ and self.exhausted(source):
                return False
            self._tick(None, source, sink)
        return True

    def seen(self, source: Source) -> Seen:
        """The ends of the queues."""
        return Seen(bool(self._coming), self._room, self._coming[0] if self._coming else 0)

    def leave(self, done: Retired, source: Source, sink: Sink) -> None:
        """The clock of issue; the result is on its way."""
        opcode = done.instruction.opcode
        if done.elements:
            self._pending.append((self.clock + latency(opcode, self.core), done))
        self._array_free = max(self._array_free, self.clock + passes(opcode, self.core))
        self._earliest = self.clock + (JUMP_CLOCKS if done.jumped else 1)
        self._tick(done, source, sink)

    @property
    def _room(self) -> bool:
        return len(self._going) + (self._written is not None) < QUEUE

    def _issues(self, instruction: Instruction) -> bool:
        opcode, now = instruction.opcode, self.clock
        if now < self._earliest or (passes(opcode, self.core) and now < self._array_free):
            return False
        if opcode is Opcode.READ and not self._coming:
            return False
        if opcode is Opcode.WRITE and not self._room:
            return False
        on_the_way = [(clock, done.matrix) for clock, done in self._pending if clock > now]
        read, takes = sources(instruction), latency(opcode, self.core)
        if any(matrix in read for _, matrix in on_the_way):
            return False
        destination = instruction.arguments[2]
        return not takes or not any(
            clock == now + takes or (clock > now + takes and matrix == destination)
            for clock, matrix in on_the_way
        )

    def _tick(self, issued: Retired | None, source: Source, sink: Sink) -> None:
        stored = next((done for clock, done in self._pending if clock == self.clock), None)
        acknowledge, ready = self.acknowledge, self.ready
        if self.events is not None and (issued or stored):
            flags = (acknowledge, ready, source.ready, sink.taken, self.saturated)
            self.events.append(Event(self.clock, flags, self.data_out, issued, stored))
        if stored:
            self.saturated |= stored.saturated
            self._pending = [(clock, done) for clock, done in self._pending if clock > self.clock]
        self._take(issued, source)
        self._give(issued, sink)
        source.advance(acknowledge, 1)
        sink.advance(ready, 1)
        self.clock += 1

    def _take(self, issued: Retired | None, source: Source) -> None:
        """A number comes in once the strobe of the one before has fallen."""
        takes = source.ready and not self.acknowledge and len(self._coming) < QUEUE
        if issued and issued.instruction.opcode is Opcode.READ:
            self._coming.popleft()
        if takes:
            self._coming.append(source.data)
        self.acknowledge = takes or (self.acknowledge and source.ready)

    def _give(self, issued: Retired | None, sink: Sink) -> None:
        """A number goes out once the one before has been taken."""
        gives = not self.ready and sink.taken and bool(self._going)
        self.ready = gives or (self.ready and sink.taken)
        if gives:
            self.data_out = self._going.popleft()
        if self._written is not None:
            self._going.append(self._written)
        self._written = issued.sent if issued else None


def clocks_of(core: Core) -> Clocks:
    """The time of a core."""
    return Overlapping(core) if core.pipelined else EightClocks(core)
