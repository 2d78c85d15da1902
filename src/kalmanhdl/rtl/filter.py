"""The filter as one component: streams, the datapath between them, the tracks' states beside it."""

from amaranth.hdl import Module, Signal, Value
from amaranth.lib.wiring import Component, In, Member, Out

from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.coefficients import Coefficients
from kalmanhdl.rtl.context import Bank, MemoryBank, RegisterBank, bank_layout, banks
from kalmanhdl.rtl.datapath import Datapath, result_cycle
from kalmanhdl.rtl.flow import Credits, ResultQueue, SkidBuffer, queue_depth
from kalmanhdl.rtl.interface import COMMAND_WIDTH, Interface, interface
from kalmanhdl.rtl.issue import Issue, pace
from kalmanhdl.rtl.layouts import result_layout, shape, step_layout
from kalmanhdl.rtl.names import identifier
from kalmanhdl.schedule.plan import Plan


def ports(shown: Interface) -> dict[str, Member]:
    """The ports of a pair of streams, by name."""
    tag = {"command": COMMAND_WIDTH} | ({"track": shown.track_width} if shown.track_width else {})
    return {
        "in_valid": In(1),
        "in_ready": Out(1),
        **{f"in_{field}": In(width) for field, width in tag.items()},
        **{port.name: In(shape(port.form)) for port in (*shown.numbers, *shown.present)},
        "out_valid": Out(1),
        "out_ready": In(1),
        **{f"out_{field}": Out(width) for field, width in tag.items()},
        **{port.name: Out(shape(port.form)) for port in shown.outputs},
    }


def loading_ports(shown: Interface) -> dict[str, Member]:
    """The ports by which coefficients are written, by name."""
    return {name: In(width) for name, width in shown.loading}


def most_held(plan: Plan) -> int:
    """Steps that a filter takes, at most, while none of its results is taken."""
    entrance, waiting, at_exit = 2, 2, 1
    return queue_depth(plan.interval, result_cycle(plan)) + entrance + waiting + at_exit


class Filter(Component):
    """The hardware of a plan, with the ports that ``interface(plan)`` tells.

    Steps may come in any order of tracks and as fast as the sender likes: one that may not start yet
    waits, and the steps behind it. Results come in the order of the steps. Reset drops the steps that
    are on the way and leaves the tracks' states, which start at zero: ``initialise`` sets a track up.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._interface = interface(plan)
        self._banks = banks(plan)
        super().__init__(ports(self._interface) | loading_ports(self._interface))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.issue = issue = self._connect_input(m)
        write_cycles = {self._plan.end(root) for _, root in self._plan.typed.graph.states}
        address_cycles = {bank.read_cycle - 1 for bank in self._banks} - {-1}
        tracked = sorted(write_cycles | address_cycles) if self._interface.track_width else []
        m.submodules.datapath = datapath = Datapath(
            self._plan, self._interface, tuple(sorted(write_cycles)), tuple(tracked)
        )
        m.d.comb += [datapath.valid.eq(issue.valid), datapath.step.eq(issue.step)]
        writes = self._show_writes(m, datapath)
        self._connect_coefficients(m, datapath)
        for bank in self._banks:
            self._connect_bank(m, bank, issue, datapath, writes)
        self._connect_output(m, issue, datapath)
        return m

    def _connect_input(self, m: Module) -> Issue:
        layout = step_layout(self._interface)
        m.submodules.entrance = entrance = SkidBuffer(layout)
        present = tuple(port.field for port in self._interface.present)
        issue = Issue(layout, present, pace(self._plan))
        offered = self.in_valid & ~self.coefficient_write if self._interface.coefficients else self.in_valid
        m.d.comb += [entrance.i.valid.eq(offered), self.in_ready.eq(entrance.i.ready)]
        for field in layout.members:
            m.d.comb += entrance.i.payload[field].eq(getattr(self, f"in_{field}"))
        m.d.comb += [
            issue.i.valid.eq(entrance.o.valid),
            issue.i.payload.eq(entrance.o.payload),
            entrance.o.ready.eq(issue.i.ready),
        ]
        return issue

    def _connect_coefficients(self, m: Module, datapath: Datapath) -> None:
        shown = self._interface
        if not shown.coefficients:
            return
        assert isinstance(self._plan.typed, TypedGraph)
        m.submodules.coefficients = kept = Coefficients(shown, self._plan.typed.coefficients)
        m.d.comb += [getattr(kept, name).eq(getattr(self, name)) for name, _ in shown.loading]
        m.d.comb += [
            getattr(datapath, port.field).eq(getattr(kept, port.field)) for port in shown.coefficients
        ]

    def _show_writes(self, m: Module, datapath: Datapath) -> dict[str, Value]:
        """Wires that show what is written to the context, by the names that ``StateWrite`` tells."""
        wires: dict[str, Value] = {}

        def show(name: str, source: Value) -> None:
            wires[name] = Signal(source.shape(), name=name, attrs={"keep": 1})
            m.d.comb += wires[name].eq(source)

        roots = dict(self._plan.typed.graph.states)
        for write in self._interface.states:
            cycle = self._plan.end(roots[write.state])
            if write.enable not in wires:
                show(write.enable, getattr(datapath, f"valid_c{cycle}"))
                if write.track:
                    show(write.track, getattr(datapath, f"track_c{cycle}"))
            show(write.data, getattr(datapath, f"next_{identifier(write.state)}"))
        return wires

    def _connect_bank(
        self, m: Module, bank: Bank, issue: Issue, datapath: Datapath, writes: dict[str, Value]
    ) -> None:
        layout = bank_layout(bank, self._plan)
        if self._plan.channels == 1:
            store = RegisterBank(layout)
        else:
            store = MemoryBank(layout, self._plan.channels)
            address = issue.next_step.track
            if bank.read_cycle > 0:
                address = getattr(datapath, f"track_c{bank.read_cycle - 1}")
            m.d.comb += [
                store.read_track.eq(address),
                store.write_track.eq(writes[f"context_write_track_c{bank.write_cycle}"]),
            ]
        m.submodules[bank.name] = store
        m.d.comb += store.write_enable.eq(writes[f"context_write_enable_c{bank.write_cycle}"])
        for field in bank.fields:
            m.d.comb += [
                getattr(datapath, field).eq(store.data[field]),
                store.write_data[field].eq(writes[f"context_write_{field}"]),
            ]

    def _connect_output(self, m: Module, issue: Issue, datapath: Datapath) -> None:
        layout = result_layout(self._interface)
        depth = queue_depth(self._plan.interval, result_cycle(self._plan))
        m.submodules.results = results = ResultQueue(layout, depth)
        m.submodules.credits = credits = Credits(depth)
        m.d.comb += [
            results.write.eq(datapath.result_valid),
            results.data.eq(datapath.result),
            credits.take.eq(issue.go),
            credits.give.eq(results.freed),
            issue.room.eq(credits.available),
            self.out_valid.eq(results.o.valid),
            results.o.ready.eq(self.out_ready),
        ]
        for field in layout.members:
            m.d.comb += getattr(self, f"out_{field}").eq(results.o.payload[field])
