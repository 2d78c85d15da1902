"""Move registers beside a multiplier into the multiplier block, which has registers of its own.

Yosys does not, and nextpnr takes the block as it comes. A registered block is faster by the routing
between block and register, and by the register's setup; the cycle in which a value appears stays.
"""

import dataclasses
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from kalmanhdl.toolchain.yosys import Netlist, count_cells

_Cell = dict[str, Any]
_Bit = int | str
_WIDTH = {"A": 18, "B": 18, "P": 36}


def absorb_registers(netlist: Netlist) -> Netlist:
    """The same design with product registers, else operand registers, inside the ECP5 multiplier blocks.

    Only registers without reset, that start at zero and share clock and enable, are absorbed. Never both
    sides of one block: nextpnr would not time what lies between.
    """
    document = json.loads(netlist.json)
    module = document["modules"][netlist.top]
    around = _Surroundings(module)
    for _, cell in sorted(module["cells"].items()):
        if cell["type"] == "MULT18X18D":
            _absorb(around, cell)
    text = json.dumps(document)
    return dataclasses.replace(netlist, json=text, cells=count_cells(text, netlist.top))


@dataclass(frozen=True, slots=True)
class _Control:
    """What registers must share to be absorbed together."""

    clock: _Bit
    enable: _Bit


class _Surroundings:
    """The registers around the blocks, and what reads and drives the bits between."""

    def __init__(self, module: dict[str, Any]) -> None:
        self._cells = module["cells"]
        self.uses = _uses(module)
        self.registers = _registers(module)
        self.by_input = {cell["connections"]["DI"][0]: name for name, cell in self.registers.items()}
        self.by_output = {cell["connections"]["Q"][0]: name for name, cell in self.registers.items()}

    def connect(self, block: _Cell, pin: str, bit: _Bit) -> None:
        """Connect an input of a block to a bit."""
        for before in block["connections"].get(pin, ()):
            self.uses[before] -= 1
        self.uses[bit] += 1
        block["connections"][pin] = [bit]
        block["port_directions"][pin] = "input"

    def remove(self, name: str) -> None:
        """Take a register away."""
        register = self.registers.pop(name)
        for pin, connected in register["connections"].items():
            if register.get("port_directions", {}).get(pin) != "output":
                self.uses.subtract(connected)
        del self.by_input[register["connections"]["DI"][0]]
        del self.by_output[register["connections"]["Q"][0]]
        del self._cells[name]


def _absorb(around: _Surroundings, block: _Cell) -> None:
    if any(key.endswith("_CLK") and value != "NONE" for key, value in block["parameters"].items()):
        return
    if not _absorb_product(around, block):
        _absorb_operands(around, block)


def _absorb_product(around: _Surroundings, block: _Cell) -> bool:
    uses, by_input = around.uses, around.by_input
    used = [pin for pin in _pins(block, "P") if uses[block["connections"][pin][0]]]
    bits = [block["connections"][pin][0] for pin in used]
    if not used or any(uses[bit] != 1 or bit not in by_input for bit in bits):
        return False
    names = [by_input[bit] for bit in bits]
    controls = {_control(around.registers[name]) for name in names}
    if len(controls) != 1:
        return False
    for pin, name in zip(used, names, strict=True):
        block["connections"][pin] = around.registers[name]["connections"]["Q"]
        around.remove(name)
    _configure(around, block, "REG_OUTPUT", "0", controls.pop())
    return True


def _absorb_operands(around: _Surroundings, block: _Cell) -> None:
    registers, by_output = around.registers, around.by_output
    found: dict[str, _Control] = {}
    for operand in "AB":
        bits = [
            bit for pin in _pins(block, operand) if (bit := block["connections"][pin][0]) not in ("0", "x")
        ]
        controls = {_control(registers[by_output[bit]]) if bit in by_output else None for bit in bits}
        if len(controls) != 1 or (control := controls.pop()) is None:
            return
        found[operand] = control
    if found["A"].clock != found["B"].clock:
        return
    passed = set()
    for operand, number in (("A", "0"), ("B", "1")):
        for pin in _pins(block, operand):
            if (bit := block["connections"][pin][0]) in by_output:
                passed.add(by_output[bit])
                around.connect(block, pin, registers[by_output[bit]]["connections"]["DI"][0])
        _configure(around, block, f"REG_INPUT{operand}", number, found[operand])
    for name in passed:
        if around.uses[registers[name]["connections"]["Q"][0]] == 0:
            around.remove(name)


def _configure(around: _Surroundings, block: _Cell, register: str, number: str, control: _Control) -> None:
    """Switch a row of the block's registers on, with the enable of that number."""
    block["parameters"] |= {
        f"{register}_CLK": "CLK0",
        f"{register}_CE": f"CE{number}",
        f"{register}_RST": "RST0",
    }
    for pin, bit in (("CLK0", control.clock), (f"CE{number}", control.enable), ("RST0", "0")):
        around.connect(block, pin, bit)


def _registers(module: dict[str, Any]) -> dict[str, _Cell]:
    """The registers that a block's own could stand for: rising edge, no reset, zero at the start."""
    return {
        name: cell
        for name, cell in module["cells"].items()
        if cell["type"] == "TRELLIS_FF"
        and cell["parameters"].get("CLKMUX", "CLK") == "CLK"
        and cell["parameters"].get("REGSET", "RESET") == "RESET"
        and cell["parameters"].get("CEMUX", "CE").strip() in ("1", "CE")
        and cell["connections"].get("LSR", ["0"]) == ["0"]
        and "DI" in cell["connections"]
    }


def _control(register: _Cell) -> _Control:
    always = register["parameters"].get("CEMUX", "CE").strip() == "1"
    enable = "1" if always else register["connections"]["CE"][0]
    return _Control(register["connections"]["CLK"][0], enable)


def _uses(module: dict[str, Any]) -> Counter[_Bit]:
    """How many cell inputs and output ports read a bit."""
    bits: list[_Bit] = []
    for port in module["ports"].values():
        if port["direction"] != "input":
            bits += port["bits"]
    for cell in module["cells"].values():
        for pin, connected in cell["connections"].items():
            if cell.get("port_directions", {}).get(pin) != "output":
                bits += connected
    return Counter(bits)


def _pins(block: _Cell, letter: str) -> Iterable[str]:
    return [pin for k in range(_WIDTH[letter]) if block["connections"].get(pin := f"{letter}{k}")]
