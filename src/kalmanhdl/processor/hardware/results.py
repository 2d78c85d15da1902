"""Results of the units of a core, and which of them an instruction writes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from amaranth.hdl import Mux, Value

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.instructions import Opcode


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """What a unit finds for some instructions: elements by their places, and whether one did not fit."""

    opcodes: tuple[Opcode, ...]
    elements: Mapping[int, Value]
    outside: Value


def chosen_results(
    core: Core, opcode: Value, otherwise: Result, results: Sequence[Result]
) -> tuple[list[Value], Value]:
    """The elements of a matrix and their flag by opcode; ``otherwise`` those of all other instructions."""
    values, outside = [otherwise.elements[e] for e in range(core.elements)], otherwise.outside
    for result in results:
        is_it = is_one_of(opcode, core, result.opcodes)
        outside = Mux(is_it, result.outside, outside)
        for element, value in result.elements.items():
            values[element] = Mux(is_it, value, values[element])
    return values, outside
