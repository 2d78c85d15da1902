"""Streams around a free-running datapath: a registered entrance, and a queue of results with credits.

The datapath never waits. A step is issued only when the queue is sure to have a place for its result,
so that the receiver can hold back the stream and nothing is lost.
"""

from amaranth import Module, Mux, Signal, signed
from amaranth.lib import stream
from amaranth.lib.data import StructLayout
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

# Cycles from the one in which a result is there until its place in the queue can be given out again.
_RETURN_CYCLES = 3


def queue_depth(interval: int, result_cycle: int) -> int:
    """Results that the queue must hold so that steps flow at full rate: a power of two, 2 at least."""
    places = -(-(result_cycle + 1 + _RETURN_CYCLES) // interval)
    return 1 << max(places - 1, 1).bit_length()


class SkidBuffer(Component):
    """A stream register that cuts valid, payload and ready; ready is low during reset."""

    def __init__(self, layout: StructLayout) -> None:
        self._layout = layout
        super().__init__({"i": In(stream.Signature(layout)), "o": Out(stream.Signature(layout))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        ready = Signal()
        valid = Signal()
        held_valid = Signal()
        payload = Signal(self._layout, reset_less=True)
        held = Signal(self._layout, reset_less=True)
        accept = self.i.valid & ready
        m.d.comb += [self.i.ready.eq(ready), self.o.valid.eq(valid), self.o.payload.eq(payload)]
        with m.If(~valid | self.o.ready):
            m.d.sync += [valid.eq(held_valid | accept), held_valid.eq(0), ready.eq(1)]
            m.d.sync += payload.eq(Mux(held_valid, held, self.i.payload))
        with m.Else():
            m.d.sync += [held_valid.eq(held_valid | accept), ready.eq(~(held_valid | accept))]
        with m.If(ready):
            m.d.sync += held.eq(self.i.payload)
        return m


class Credits(Component):
    """Counts the places left in a queue of ``depth``: ``take`` one when ``available``, ``give`` it back."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        super().__init__({"take": In(1), "give": In(1), "available": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # One less than the places left: its sign alone says that there is none.
        spare = Signal(signed(self._depth.bit_length() + 1), init=self._depth - 1)
        m.d.sync += spare.eq(spare + self.give - self.take)
        m.d.comb += self.available.eq(~spare[-1])
        return m


class ResultQueue(Component):
    """A queue of results: written whenever ``write`` is high, read as a stream.

    It knows no full state: whoever writes holds credits. ``freed`` is high once for each place that can
    be written again. ``in_luts``: it is small, and no block RAM, whose words come late in a cycle.
    """

    def __init__(self, layout: StructLayout, depth: int, *, in_luts: bool = False) -> None:
        self._layout = layout
        self._depth = depth
        self._style = {"ram_style": "distributed"} if in_luts else {}
        super().__init__(
            {"write": In(1), "data": In(layout), "freed": Out(1), "o": Out(stream.Signature(layout))}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # The two addresses never meet in a cycle, so a bypass would be waste.
        m.submodules.memory = memory = Memory(
            shape=self._layout, depth=self._depth, init=[], attrs={"no_rw_check": 1, **self._style}
        )
        write, read = memory.write_port(), memory.read_port()
        write_place = Signal(range(self._depth))
        read_place = Signal(range(self._depth))
        fetch = Signal()
        valid = Signal()
        freed = Signal()
        # One less than the results waiting: its sign alone says that there is none.
        waiting = Signal(signed(self._depth.bit_length() + 1), init=-1)
        m.d.comb += [
            fetch.eq(~waiting[-1] & (~valid | self.o.ready)),
            write.addr.eq(write_place),
            write.data.eq(self.data),
            write.en.eq(self.write),
            read.addr.eq(read_place),
            read.en.eq(fetch),
            self.o.valid.eq(valid),
            self.o.payload.eq(read.data),
            self.freed.eq(freed),
        ]
        m.d.sync += [
            write_place.eq(write_place + self.write),
            read_place.eq(read_place + fetch),
            waiting.eq(waiting + self.write - fetch),
            valid.eq(fetch | (valid & ~self.o.ready)),
            freed.eq(fetch),
        ]
        return m
