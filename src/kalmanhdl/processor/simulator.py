"""The instruction-set simulator: what every instruction does; ``clocks.py`` says at which clock."""

from collections.abc import Callable
from dataclasses import dataclass, field

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.arithmetic import compute
from kalmanhdl.processor.clocks import Clocks, Retired, Seen, clocks_of
from kalmanhdl.processor.core import Core, checked, writes
from kalmanhdl.processor.instructions import Instruction, Opcode
from kalmanhdl.processor.peripherals import Sink, Source


@dataclass(slots=True)
class Machine:
    """A core while it runs: its stores, its program counter and its time.

    The data store lasts from program to program. It starts with zeros.
    """

    core: Core
    source: Source
    sink: Sink
    address: int = 0
    saturated: bool = False
    """Whether any result since the reset did not fit."""
    data: list[list[int]] = field(init=False)
    time: Clocks = field(init=False)
    _program: list[Instruction] = field(init=False)
    _loops: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.data = [[0] * self.core.elements for _ in range(self.core.matrices)]
        self.time = clocks_of(self.core)
        self.load(())

    def load(self, words: tuple[int, ...]) -> None:
        """A reset, and a program in the control store; the rest of it is NOP.

        Raises ProgramError for words that the core cannot run.
        """
        instructions = checked(words, self.core)
        rest = self.core.program_words - len(instructions)
        self._program = [*instructions, *[Instruction(Opcode.NOP)] * rest]
        for lost in self.time.reset():
            self.data[lost.matrix][lost.elements.start : lost.elements.stop] = lost.before
        self.address = 0
        self.saturated = False
        self._loops = []

    @property
    def clock(self) -> int:
        """Clocks since the core runs."""
        return self.time.clock

    @property
    def exhausted(self) -> bool:
        """Whether nothing more will ever be read."""
        return self.time.exhausted(self.source)

    @property
    def next_instruction(self) -> Instruction:
        """What ``retire`` will do."""
        return self._program[self.address]

    def settle(self) -> bool:
        """Live up to the clock in which the next instruction takes effect; whether it ever will."""
        return self.time.reach(self.next_instruction, self.source, self.sink)

    def retire(self) -> Retired:
        """One instruction, to the end of the clock in which it takes effect.

        Raises ProgramError for a READ that waits for what never comes.
        """
        if not self.settle():
            raise ProgramError(f"address {self.address}: READ: the input is exhausted")
        seen = self.time.seen(self.source)
        instruction = self.next_instruction
        at = self.clock, self.address
        target = self._target(instruction, seen)
        first, second, third = instruction.arguments
        match instruction.opcode:
            case Opcode.READ:
                done = self._stored(at, instruction, [self.core.numbers.taken(seen.data_in)], outside=False)
            case Opcode.WRITE:
                done = Retired(*at, instruction, sent=self.data[first][second])
            case _ if writes(instruction, self.core):
                # The second argument of some is an element or an exponent.
                a, b, c = self.data[first], self.data[second % self.core.matrices], self.data[third]
                done = self._stored(at, instruction, *compute(instruction, a, b, self.core, c))
            case _:
                done = Retired(*at, instruction, jumped=target is not None)
        self.address = (self.address + 1) % self.core.program_words if target is None else target
        self.time.leave(done, self.source, self.sink)
        return done

    def _target(self, instruction: Instruction, seen: Seen) -> int | None:
        """Where it goes, if not to the next address; loops are begun and ended."""
        first = instruction.arguments[0]
        match instruction.opcode:
            case Opcode.HALT:
                return self.address
            case Opcode.JUMP_U:
                return first
            case Opcode.JUMP_DRDY:
                return None if seen.input_ready else first
            case Opcode.JUMP_ACK:
                return None if seen.output_taken else first
            case Opcode.NEXT:
                return first if self._another() else None
            case Opcode.LOOP:
                self._loops.append(first)
                return None
            case _:
                return None

    def _another(self) -> bool:
        """Whether the innermost loop is passed once more; it is left otherwise."""
        self._loops[-1] -= 1
        if self._loops[-1]:
            return True
        self._loops.pop()
        return False

    def _stored(
        self, at: tuple[int, int], instruction: Instruction, values: list[int], outside: bool
    ) -> Retired:
        elements, matrix = writes(instruction, self.core), instruction.arguments[2]
        place = slice(elements.start, elements.stop)
        before = tuple(self.data[matrix][place])
        self.data[matrix][place] = values
        self.saturated |= outside
        return Retired(*at, instruction, matrix, elements, tuple(values), before, outside)


@dataclass(frozen=True, slots=True)
class Run:
    """How a run ended, and what it put out, in the order of the WRITEs."""

    reason: str
    instructions: int
    sent: tuple[int, ...]


def run(
    machine: Machine,
    most: int,
    stops: frozenset[int] = frozenset(),
    watch: Callable[[Retired], None] = lambda done: None,
) -> Run:
    """Run until HALT, the end of the input, an address in ``stops``, or for ``most`` instructions.

    ``watch`` is called after every instruction.
    """
    sent: list[int] = []
    for count in range(most):
        waiting = machine.next_instruction.opcode in (Opcode.READ, Opcode.JUMP_DRDY)
        if waiting and machine.exhausted:
            return Run("the input is exhausted", count, tuple(sent))
        if machine.next_instruction.opcode is Opcode.HALT:
            return Run(f"halted at address {machine.address}", count, tuple(sent))
        if machine.address in stops and count:
            return Run(f"stopped at address {machine.address}", count, tuple(sent))
        if not machine.settle():
            return Run("the input is exhausted", count, tuple(sent))
        done = machine.retire()
        if done.sent is not None:
            sent.append(done.sent)
        watch(done)
    return Run(f"{most} instructions are done", most, tuple(sent))
