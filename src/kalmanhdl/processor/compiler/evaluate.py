"""The engine: a traced filter run in the processor's order of operations, on raw numbers or on floats."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.arithmetic import compute
from kalmanhdl.processor.compiler.graph import (
    Array,
    Computed,
    Constant,
    Given,
    Held,
    Node,
    Put,
    Read,
    Section,
)
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core, writes
from kalmanhdl.processor.instructions import OPERATIONS, Instruction, Kind, build

Raw = tuple[int, ...]


def raw_constant(name: str, values: Array, core: Core) -> list[int]:
    """The raw elements of a constant in the store.

    Raises ProgramError where one is outside the core's numbers, or so small that nothing of it would be left.
    """
    raws = []
    for value in padded(values, core.size).ravel():
        if not core.numbers.holds(float(value)):
            remedy = "take more bits for the exponent" if core.floating else "change fraction or units"
            raise ProgramError(f"the constant {value:.6g} of {name} is no number of {core.form}: {remedy}")
        # Zero has no sign: constants that come in by products with zeros lose it.
        raws.append(core.numbers.nearest(float(value) + 0.0))
    return raws


def padded(values: Array, size: int) -> Array:
    """A constant as it stands in a matrix of the store."""
    whole = np.zeros((size, size))
    whole[: values.shape[0], : values.shape[1]] = values
    return whole


@dataclass(slots=True)
class Engine:
    """The filter on one track, bit for bit as the program computes it."""

    filter_: Traced
    core: Core
    saturated: bool = False
    _held: dict[str, list[int]] = field(default_factory=dict)
    _constants: dict[str, list[int]] = field(init=False)
    _rows: int = 0

    def __post_init__(self) -> None:
        self._constants = {
            name: raw_constant(name, array, self.core) for name, array in self.filter_.constants.items()
        }

    def step(self, given: Sequence[int]) -> Raw:
        """What is put out after one pass, from the flags, measurements and controls that it reads."""
        numbers = iter(given)
        for block in self.filter_.row(self._rows):
            for _ in range(block.times):
                self._pass(block.section, numbers)
        self._rows += 1
        stored = self.stored
        return tuple(stored[name][element] for name, element in self.filter_.outputs)

    def _pass(self, section: Section, numbers: Iterator[int]) -> None:
        values: dict[int, list[int]] = {}
        for index in section.live:
            node = section.nodes[index]
            values[index] = [next(numbers)] if isinstance(node, Read) else self._value(section, node, values)
            if isinstance(node, Given):
                self._held[node.name] = values[index]
        self._held |= {name: values[node] for name, node in section.held.items()}

    @property
    def stored(self) -> Mapping[str, list[int]]:
        """The raw elements of what stays from pass to pass, and of the constants."""
        return {**self._constants, **self._held}

    def _value(self, section: Section, node: Node, values: Mapping[int, list[int]]) -> list[int]:
        result = [0] * self.core.elements
        match node:
            case Constant(name):
                return self._constants[name]
            case Held(name):
                return self._held.setdefault(name, [0] * self.core.elements)
            case Given(_, reads):
                for index in reads:
                    read = section.nodes[index]
                    assert isinstance(read, Read)
                    result[read.element] = values[index][0]
            case Computed():
                instruction = instruction_of(node, [0] * len(node.sources), 0)
                sources = [values[source] for source in node.sources]
                a, b, c = sources[0], sources[min(1, len(sources) - 1)], sources[-1]
                found, outside = compute(instruction, a, b, self.core, c)
                self.saturated |= outside
                if node.in_place:
                    result = list(c)
                written = writes(instruction, self.core)
                result[written.start : written.stop] = found
            case Read() | Put():
                raise AssertionError(node)
        return result


def instruction_of(node: Computed, sources: Sequence[int], destination: int) -> Instruction:
    """The instruction of a node, its sources and its destination at these addresses."""
    places = iter(sources)
    kinds = [operand.kind for operand in OPERATIONS[node.opcode.name].operands[:-1]]
    operands = [next(places) if kind is Kind.MATRIX else node.immediate for kind in kinds]
    return build(node.opcode, *operands, destination)
