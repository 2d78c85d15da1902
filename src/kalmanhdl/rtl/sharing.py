"""One stream of steps for several lanes, and their results as one stream again."""

from amaranth import Cat, Module, Signal, Value
from amaranth.lib import stream
from amaranth.lib.data import StructLayout, View
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.rtl.flow import SkidBuffer


class Distributor(Component):
    """Hands steps on to the lanes that the low bits of their tracks name, in their order.

    Where the bits name no lane it is the last one. A step whose lane is not ready holds back those behind it.
    ``handed`` is high in each cycle in which a lane takes a step, and ``lane`` is its number. A lane's step
    has the rest of the bits as its track, none where it keeps one track.
    """

    def __init__(self, shared: StructLayout, inner: StructLayout, lanes: int, lane_width: int) -> None:
        self._shared, self._inner, self._lanes = shared, inner, lanes
        super().__init__(
            {
                "i": In(stream.Signature(shared)),
                "o": Out(stream.Signature(inner)).array(lanes),
                "handed": Out(1),
                "lane": Out(lane_width),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.entrance = entrance = SkidBuffer(self._shared)
        step, ready = entrance.o.payload, Signal()
        m.d.comb += [
            entrance.i.valid.eq(self.i.valid),
            entrance.i.payload.eq(self.i.payload),
            self.i.ready.eq(entrance.i.ready),
            self.lane.eq(step.track),
            self.handed.eq(entrance.o.valid & ready),
            entrance.o.ready.eq(ready),
        ]
        for chosen, o in zip(_chosen(self.lane, self._lanes), self.o, strict=True):
            m.d.comb += [o.valid.eq(entrance.o.valid & chosen), *self._copied(o.payload, step)]
            with m.If(chosen):
                m.d.comb += ready.eq(o.ready)
        return m

    def _copied(self, target: View, step: View) -> list[object]:
        return [
            target[field].eq(step.track[len(self.lane) :] if field == "track" else step[field])
            for field in self._inner.members
        ]


class Collector(Component):
    """Takes the results of the lanes in the order in which ``order`` names the lanes."""

    def __init__(self, shared: StructLayout, inner: StructLayout, lanes: int, order: StructLayout) -> None:
        self._shared, self._inner, self._lanes = shared, inner, lanes
        super().__init__(
            {
                "order": In(stream.Signature(order)),
                "i": In(stream.Signature(inner)).array(lanes),
                "o": Out(stream.Signature(shared)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.exit = exit_ = SkidBuffer(self._shared)
        lane, there = self.order.payload.lane, Signal()
        result = Signal(self._inner)
        m.d.comb += [
            exit_.i.valid.eq(self.order.valid & there),
            self.order.ready.eq(exit_.i.ready & there),
            self.o.valid.eq(exit_.o.valid),
            self.o.payload.eq(exit_.o.payload),
            exit_.o.ready.eq(self.o.ready),
        ]
        for chosen, i in zip(_chosen(lane, self._lanes), self.i, strict=True):
            m.d.comb += i.ready.eq(self.order.valid & exit_.i.ready & chosen)
            with m.If(chosen):
                m.d.comb += [there.eq(i.valid), result.eq(i.payload)]
        for field in self._shared.members:
            value = self._track(result, lane) if field == "track" else result[field]
            m.d.comb += exit_.i.payload[field].eq(value)
        return m

    def _track(self, result: View, lane: Value) -> Value:
        return Cat(lane, result.track) if "track" in self._inner.members else lane


def _chosen(lane: Value, lanes: int) -> list[Value]:
    """For each lane whether it is the one of that number; the last one also stands for numbers beyond."""
    return [*(lane == number for number in range(lanes - 1)), lane >= lanes - 1]
