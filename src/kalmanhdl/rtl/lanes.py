"""Several filters side by side: a track lives in one of them, chosen by its id."""

from amaranth import ClockSignal, Instance, Module, ResetSignal, Signal
from amaranth.lib.data import StructLayout
from amaranth.lib.stream import Interface as StreamPort
from amaranth.lib.wiring import Component, In

from kalmanhdl.design import Streams
from kalmanhdl.rtl.filter import loading_ports, most_held, ports
from kalmanhdl.rtl.flow import ResultQueue
from kalmanhdl.rtl.interface import interface, lane_name
from kalmanhdl.rtl.layouts import result_layout, step_layout
from kalmanhdl.rtl.sharing import Collector, Distributor
from kalmanhdl.schedule.plan import Plan

Wires = dict[str, Signal]


class Lanes(Component):
    """``lanes`` filters of a plan, with the ports that ``interface(plan, lanes, streams)`` tells.

    Each lane is an instance of ``module``, which is a ``Filter`` of the plan. Of shared streams the results
    come in the order of the steps, whichever lanes they went to.
    """

    def __init__(self, plan: Plan, lanes: int, streams: Streams, module: str) -> None:
        self._plan = plan
        self._module = module
        self._lane = interface(plan)
        self._shown = shown = interface(plan, lanes, streams)
        super().__init__(
            {f"{pair}{name}": way for pair in shown.streams for name, way in ports(shown).items()}
            | loading_ports(shown)
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        lanes = [self._wires(lane) for lane in range(self._shown.lanes)]
        for lane, wires in enumerate(lanes):
            m.submodules[lane_name(lane)] = self._instance(wires)
            m.d.comb += [wires[name].eq(getattr(self, name)) for name, _ in self._shown.loading]
        if self._shown.lane_width:
            self._share(m, lanes)
        else:
            for pair, wires in zip(self._shown.streams, lanes, strict=True):
                self._lead_out(m, pair, wires)
        return m

    def _wires(self, lane: int) -> Wires:
        """Wires for the ports of a lane."""
        own = (ports(self._lane) | loading_ports(self._lane)).items()
        return {name: Signal(way.shape, name=f"{lane_name(lane)}_inside_{name}") for name, way in own}

    def _instance(self, wires: Wires) -> Instance:
        ways = ports(self._lane) | loading_ports(self._lane)
        takes = {f"i_{name}": wire for name, wire in wires.items() if ways[name].flow is In}
        gives = {f"o_{name}": wire for name, wire in wires.items() if ways[name].flow is not In}
        return Instance(self._module, i_clk=ClockSignal(), i_rst=ResetSignal(), **takes, **gives)

    def _lead_out(self, m: Module, pair: str, wires: Wires) -> None:
        for name, way in ports(self._lane).items():
            port = getattr(self, f"{pair}{name}")
            m.d.comb += wires[name].eq(port) if way.flow is In else port.eq(wires[name])

    def _share(self, m: Module, lanes: list[Wires]) -> None:
        width, most = self._shown.lane_width, len(lanes) * most_held(self._plan)
        step, result = step_layout(self._shown), result_layout(self._shown)
        inner_step, inner_result = step_layout(self._lane), result_layout(self._lane)
        number = StructLayout({"lane": width})
        m.submodules.distributor = distributor = Distributor(step, inner_step, len(lanes), width)
        m.submodules.collector = collector = Collector(result, inner_result, len(lanes), number)
        # With a place for every step that the lanes can hold it is never full.
        m.submodules.order = order = ResultQueue(number, 1 << (most - 1).bit_length(), in_luts=True)
        own = {name: getattr(self, name) for name in ports(self._shown)}
        if self._shown.loading:
            own["in_valid"] = Signal(name="step_valid")
            m.d.comb += own["in_valid"].eq(self.in_valid & ~self.coefficient_write)
        m.d.comb += [
            *_put_in(distributor.i, own, step),
            *_take_out(collector.o, own, result),
            order.write.eq(distributor.handed),
            order.data.lane.eq(distributor.lane),
            collector.order.valid.eq(order.o.valid),
            collector.order.payload.eq(order.o.payload),
            order.o.ready.eq(collector.order.ready),
        ]
        for lane, wires in enumerate(lanes):
            m.d.comb += _take_out(distributor.o[lane], wires, inner_step, "in")
            m.d.comb += _put_in(collector.i[lane], wires, inner_result, "out")


def _put_in(port: StreamPort, wires: Wires, layout: StructLayout, way: str = "in") -> list[object]:
    """The stream on wires leads into a port."""
    fields = [port.payload[field].eq(wires[f"{way}_{field}"]) for field in layout.members]
    return [port.valid.eq(wires[f"{way}_valid"]), wires[f"{way}_ready"].eq(port.ready), *fields]


def _take_out(port: StreamPort, wires: Wires, layout: StructLayout, way: str = "out") -> list[object]:
    """The stream of a port leads to wires."""
    fields = [wires[f"{way}_{field}"].eq(port.payload[field]) for field in layout.members]
    return [wires[f"{way}_valid"].eq(port.valid), port.ready.eq(wires[f"{way}_ready"]), *fields]
