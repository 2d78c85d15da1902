"""Files, units and the ways between them, as a row of control says."""

from collections.abc import Sequence

from amaranth.hdl import Array, Cat, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.programmable.control import WATCH_RUNNING, WATCH_STARTING, Layout
from kalmanhdl.programmable.hardware.divider import PowerDivider
from kalmanhdl.programmable.hardware.file import OperandFile
from kalmanhdl.programmable.hardware.reciprocal import TableReciprocal
from kalmanhdl.programmable.hardware.stage import RoundingStage
from kalmanhdl.programmable.hardware.units import Adder
from kalmanhdl.programmable.image import Image
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.names import identifier
from kalmanhdl.rtl.stages import named


class ProgrammableDatapath(wiring.Component):
    """One row of control after the other, on the numbers of one step.

    ``row`` counts while ``active`` is high. ``inputs`` stand from the first row to the last. ``bank`` says
    where states are read; they are written to the other one. ``left`` tells that a watched value left its
    format in the clock before. The outputs stand in registers until the next step writes them. ``load``
    writes ``data`` to ``load_place`` of the file whose bit is high.
    """

    def __init__(self, layout: Layout, image: Image) -> None:
        self._layout, self._shape, self._image = layout, layout.shape, image
        shape = self._shape
        place = (shape.words - 1).bit_length()
        super().__init__(
            {
                "row": In(layout.row_bits),
                "active": In(1),
                "bank": In(1),
                "initialise": In(1),
                **{f"in_{identifier(name)}": In(signed(shape.number_width)) for name in shape.inputs},
                **{identifier(name): Out(signed(shape.number_width)) for name in shape.outputs},
                "left": Out(1),
                "load": In(len(shape.files)),
                "load_place": In(place),
                "data": In(shape.word_width),
            }
        )

    def field(self, name: str) -> Value:
        """A field of the row."""
        place = self._layout.places[name]
        return self.row[place : place + self._layout.fields[name]]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        operands = self._files(m)
        results, left = self._units(m, operands)
        for file in self._shape.files:
            chosen = self._chosen(m, file, results)
            m.d.comb += m.submodules[file].data.eq(chosen)
            self._show(m, file, chosen)
        m.d.sync += self.left.eq(self.active & Cat(*left).any())
        self._outputs(m, results)
        return m

    def _files(self, m: Module) -> dict[str, Value]:
        """The operands, in registers: what a file gave is slow to come."""
        found: dict[str, Value] = {}
        for number, name in enumerate(self._shape.files):
            m.submodules[name] = file = OperandFile(self._shape, name, self._image.files[name])
            m.d.comb += [
                file.read.eq(self._address(f"{name}_read", self.bank)),
                file.write.eq(self._address(f"{name}_write", self.bank)),
                file.enable.eq(self.active & self.field(f"{name}_enable")),
                file.load.eq(self.load[number]),
                file.load_place.eq(self.load_place),
                file.loaded.eq(self.data),
            ]
            flag = self._shape.file_width(name) == 1
            operand = Signal.like(file.word if flag else file.word.as_signed(), name=name, reset_less=True)
            m.d.sync += operand.eq(file.word)
            found[name] = operand
        return found

    def _address(self, name: str, bank: Value) -> Value:
        field = self.field(name)
        return Cat(field[0] ^ (field[-1] & bank), field[1:-1])

    def _units(self, m: Module, operands: dict[str, Value]) -> tuple[list[Value], list[Value]]:
        """The result of every unit, and what leaves its format while it is watched."""
        results, left = [], []
        for unit in self._shape.unit_names:
            if unit == "reciprocal":
                results.append(self._reciprocal(m, operands))
            elif unit == "input":
                results.append(self._given(m))
            else:
                raw = self._exact(m, unit, operands)
                word, out = self._staged(m, unit, raw)
                results.append(word)
                left.append(out)
        return results, left

    def _exact(self, m: Module, unit: str, operands: dict[str, Value]) -> Value:
        shape = self._shape
        if unit.startswith("add"):
            m.submodules[unit] = adder = Adder(shape)
            ports = {port: operands[f"{unit}_{port}"] for port in shape.ports(unit)}
            m.d.comb += [getattr(adder, port).eq(value) for port, value in ports.items()]
            m.d.comb += adder.function.eq(self.field(f"{unit}_function"))
            return adder.raw
        m.submodules[unit] = multiplier = Multiplier(
            signed(shape.number_width), signed(shape.operand_width), 1
        )
        m.d.comb += [multiplier.a.eq(operands[f"{unit}_a"]), multiplier.b.eq(operands[f"{unit}_b"])]
        return multiplier.product

    def _staged(self, m: Module, unit: str, raw: Value) -> tuple[Value, Value]:
        m.submodules[f"{unit}_stage"] = stage = RoundingStage(len(raw), self._shape)
        m.d.comb += stage.raw.eq(raw)
        for name in ("shift", "rounding", "width", "unsigned", "wrap"):
            m.d.comb += getattr(stage, name).eq(self.field(f"{unit}_{name}"))
        when = Mux(self.initialise, WATCH_STARTING, WATCH_RUNNING)
        return stage.word, stage.outside & (self.field(f"{unit}_watch") & when).any()

    def _reciprocal(self, m: Module, operands: dict[str, Value]) -> Value:
        if self._shape.reciprocal_table is not None:
            m.submodules.reciprocal = table = TableReciprocal(self._shape, self._shape.reciprocal_table)
            m.d.comb += table.divisor.eq(operands["reciprocal_a"])
            return table.word
        m.submodules.reciprocal = divider = PowerDivider(self._shape)
        m.d.comb += [
            divider.begin.eq(self.active & self.field("reciprocal_begin")),
            divider.divisor.eq(operands["reciprocal_a"]),
            divider.clocks.eq(self.field("reciprocal_clocks")),
            divider.place.eq(self.field("reciprocal_place")),
        ]
        return divider.word

    def _given(self, m: Module) -> Value:
        given = Signal(signed(self._shape.number_width), reset_less=True)
        inputs = [getattr(self, f"in_{identifier(name)}") for name in self._shape.inputs]
        m.d.sync += given.eq(_one_of(self.field("input_choice"), inputs))
        return given

    def _chosen(self, m: Module, file: str, results: Sequence[Value]) -> Value:
        chosen = Signal(signed(self._shape.word_width), name=f"{file}_chosen")
        m.d.comb += chosen.eq(_one_of(self.field(f"{file}_source"), results))
        return chosen

    def _show(self, m: Module, file: str, chosen: Value) -> None:
        """Wires by which states that are written can be watched, and which cost no logic."""
        field = self.field(f"{file}_write")
        shown = {
            "enable": self.active & self.field(f"{file}_enable") & field[-1],
            "place": field[1:-1],
            "data": chosen[: self._shape.file_width(file)],
        }
        for what, value in shown.items():
            wire = Signal(value.shape(), name=f"state_{what}_{file}", attrs={"keep": 1})
            m.d.comb += wire.eq(value)

    def _outputs(self, m: Module, results: Sequence[Value]) -> None:
        value = named(m, "output_chosen", _one_of(self.field("output_source"), results))
        for number, name in enumerate(self._shape.outputs):
            register = Signal(
                signed(self._shape.number_width), name=f"put_{identifier(name)}", reset_less=True
            )
            here = self.field("output_write") == number
            with m.If(self.active & self.field("output_enable") & here):
                m.d.sync += register.eq(value)
            m.d.comb += getattr(self, identifier(name)).eq(register)


def _one_of(number: Value, values: Sequence[Value]) -> Value:
    """The value of a number; beyond the last one any."""
    return Array(values)[number]
