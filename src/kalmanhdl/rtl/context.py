"""Where the tracks' states wait between two steps: registers for one track, memories for many."""

from collections.abc import Iterator
from dataclasses import dataclass

from amaranth import Module, Signal
from amaranth.lib.data import StructLayout
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.graph.operations import State, StateFlag
from kalmanhdl.rtl.interface import track_width
from kalmanhdl.rtl.layouts import shape
from kalmanhdl.rtl.names import identifier
from kalmanhdl.schedule.plan import Plan


@dataclass(frozen=True, slots=True, kw_only=True)
class Bank:
    """The states that are read in one cycle of a step and written in another.

    ``fields[k]`` is the field of the state, ``reads[k]`` its operation and ``writes[k]`` the root whose
    value it takes.
    """

    read_cycle: int
    write_cycle: int
    fields: tuple[str, ...]
    reads: tuple[int, ...]
    writes: tuple[int, ...]

    @property
    def name(self) -> str:
        """A name that no other bank of the plan has."""
        return f"context_r{self.read_cycle}_w{self.write_cycle}"


def banks(plan: Plan) -> tuple[Bank, ...]:
    """The banks of a plan, by read cycle, then write cycle."""
    roots = dict(plan.typed.graph.states)
    members: dict[tuple[int, int], list[tuple[str, int, int]]] = {}
    for index, name in _state_operations(plan):
        root = roots[name]
        cycles = plan.start[index], plan.end(root)
        members.setdefault(cycles, []).append((identifier(name), index, root))
    return tuple(
        Bank(
            read_cycle=read,
            write_cycle=write,
            fields=tuple(field for field, _, _ in found),
            reads=tuple(index for _, index, _ in found),
            writes=tuple(root for _, _, root in found),
        )
        for (read, write), found in sorted(members.items())
    )


def _state_operations(plan: Plan) -> Iterator[tuple[int, str]]:
    for index, operation in enumerate(plan.typed.graph.operations):
        if isinstance(operation, State | StateFlag):
            yield index, operation.name


def bank_layout(bank: Bank, plan: Plan) -> StructLayout:
    """The word that a bank keeps of each track."""
    return StructLayout(
        {
            field: shape(plan.typed.formats[index])
            for field, index in zip(bank.fields, bank.reads, strict=True)
        }
    )


class RegisterBank(Component):
    """The states of the one track. ``data`` is what stands there in the same cycle.

    Reset leaves the states as they are; they start at zero.
    """

    def __init__(self, layout: StructLayout) -> None:
        self._layout = layout
        super().__init__({"data": Out(layout), "write_enable": In(1), "write_data": In(layout)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        for field in self._layout.members:
            register = Signal(self._layout[field].shape, name=field, reset_less=True)
            with m.If(self.write_enable):
                m.d.sync += register.eq(self.write_data[field])
            m.d.comb += self.data[field].eq(register)
        return m


class MemoryBank(Component):
    """The states of many tracks. ``data`` belongs to the ``read_track`` of the cycle before.

    A word written in one cycle can be addressed in the next; what a read of the word being written
    gives is left open, and never used: the steps of a track are issued far enough apart. Reset leaves
    the states as they are; they start at zero.
    """

    def __init__(self, layout: StructLayout, channels: int) -> None:
        self._layout = layout
        self._channels = channels
        track = track_width(channels)
        super().__init__(
            {
                "read_track": In(track),
                "data": Out(layout),
                "write_enable": In(1),
                "write_track": In(track),
                "write_data": In(layout),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # Without the attribute Yosys adds a bypass that no step needs.
        m.submodules.memory = memory = Memory(
            shape=self._layout, depth=self._channels, init=[], attrs={"no_rw_check": 1}
        )
        write, read = memory.write_port(), memory.read_port()
        m.d.comb += [
            write.addr.eq(self.write_track),
            write.data.eq(self.write_data),
            write.en.eq(self.write_enable),
            read.addr.eq(self.read_track),
            self.data.eq(read.data),
        ]
        return m
