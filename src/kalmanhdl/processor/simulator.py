"""The instruction-set simulator: what every instruction does, and at which clock."""

from collections.abc import Callable
from dataclasses import dataclass, field

from kalmanhdl.processor.arithmetic import compute
from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION, Core, checked, writes
from kalmanhdl.processor.instructions import Instruction, Opcode
from kalmanhdl.processor.peripherals import Sink, Source


@dataclass(frozen=True, slots=True)
class Retired:
    """An instruction at its last clock, and what it has done by the next one.

    ``clock`` counts from the first clock of the first instruction. ``values`` went to the elements
    ``elements`` of the matrix ``matrix``. ``saturated``: a result did not fit the format. ``sent``: what a
    WRITE put out.
    """

    clock: int
    address: int
    instruction: Instruction
    matrix: int = 0
    elements: range = range(0)
    values: tuple[int, ...] = ()
    saturated: bool = False
    sent: int | None = None


@dataclass(slots=True)
class Machine:
    """A core while it runs: its stores, its program counter and its handshakes.

    The data store lasts from program to program. It starts with zeros.
    """

    core: Core
    source: Source
    sink: Sink
    clock: int = 0
    address: int = 0
    acknowledge: bool = False
    """ACK_I."""
    ready: bool = False
    """DRDY_O."""
    data_out: int = 0
    saturated: bool = False
    """Whether any result since the reset did not fit."""
    data: list[list[int]] = field(init=False)
    _program: list[Instruction] = field(init=False)
    _waited_for: tuple[bool, bool] = (False, False)
    _loops: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.data = [[0] * self.core.elements for _ in range(self.core.matrices)]
        self.load(())

    def load(self, words: tuple[int, ...]) -> None:
        """A reset, and a program in the control store; the rest of it is NOP.

        Raises ProgramError for words that the core cannot run.
        """
        instructions = checked(words, self.core)
        rest = self.core.program_words - len(instructions)
        self._program = [*instructions, *[Instruction(Opcode.NOP)] * rest]
        self.clock = self.address = self.data_out = 0
        self.acknowledge = self.ready = self.saturated = False
        self._loops = []

    @property
    def next_instruction(self) -> Instruction:
        """What ``retire`` will do."""
        return self._program[self.address]

    def settle(self) -> None:
        """Live through the clocks of the next instruction up to its last one, if that has not been done.

        The jumps look at their signals in the clock before.
        """
        left = CLOCKS_PER_INSTRUCTION - 1 - self.clock % CLOCKS_PER_INSTRUCTION
        if left:
            self._pass(left - 1)
            self._waited_for = self.source.ready, self.sink.taken
            self._pass(1)

    def retire(self) -> Retired:
        """One instruction, to the end of its last clock."""
        self.settle()
        instruction = self.next_instruction
        (input_ready, output_taken), data_in = self._waited_for, self.source.data
        acknowledge, ready = self.acknowledge, self.ready
        self._pass(1)
        at = self.clock - 1, self.address
        following = (self.address + 1) % self.core.program_words
        done = Retired(*at, instruction)
        first, second, third = instruction.arguments
        match instruction.opcode:
            case Opcode.NOP:
                pass
            case Opcode.HALT:
                following = self.address
            case Opcode.JUMP_U:
                following = first
            case Opcode.LOOP:
                self._loops.append(first)
            case Opcode.NEXT:
                following = first if self._another() else following
            case Opcode.JUMP_DRDY:
                acknowledge = False
                following = following if input_ready else first
            case Opcode.JUMP_ACK:
                ready = False
                following = following if output_taken else first
            case Opcode.READ:
                acknowledge = True
                self.data[third][second] = data_in
                self.source.read()
                done = Retired(*at, instruction, third, range(second, second + 1), (data_in,))
            case Opcode.WRITE:
                ready, self.data_out = True, self.data[first][second]
                done = Retired(*at, instruction, sent=self.data_out)
            case _:
                done = self._computed(at, instruction)
        self.acknowledge, self.ready, self.address = acknowledge, ready, following
        return done

    def _another(self) -> bool:
        """Whether the innermost loop is passed once more; it is left otherwise."""
        self._loops[-1] -= 1
        if self._loops[-1]:
            return True
        self._loops.pop()
        return False

    def _pass(self, clocks: int) -> None:
        self.source.advance(self.acknowledge, clocks)
        self.sink.advance(self.ready, clocks)
        self.clock += clocks

    def _computed(self, at: tuple[int, int], instruction: Instruction) -> Retired:
        first, second, third = instruction.arguments
        # The second argument of some is an element or an exponent.
        a, b = self.data[first], self.data[second % self.core.matrices]
        values, outside = compute(instruction, a, b, self.core)
        elements = writes(instruction, self.core)
        self.data[third][elements.start : elements.stop] = values
        self.saturated |= outside
        return Retired(*at, instruction, third, elements, tuple(values), outside)


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
        if waiting and machine.source.exhausted:
            return Run("the input is exhausted", count, tuple(sent))
        if machine.next_instruction.opcode is Opcode.HALT:
            return Run(f"halted at address {machine.address}", count, tuple(sent))
        if machine.address in stops and count:
            return Run(f"stopped at address {machine.address}", count, tuple(sent))
        done = machine.retire()
        if done.sent is not None:
            sent.append(done.sent)
        watch(done)
    return Run(f"{most} instructions are done", most, tuple(sent))
