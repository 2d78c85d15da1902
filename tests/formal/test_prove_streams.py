"""The streams around a datapath, proven for ever: no token is lost, doubled or moved, and none gets stuck.

Senders, receivers and resets may do anything in any clock. Tokens carry their own number, so that the
receiver knows which one it must get; what is asserted of a component's registers makes the induction whole.
"""

from itertools import pairwise

import pytest
from amaranth.hdl import Assert, Cat, Const, Module, Mux, Signal
from amaranth.lib.data import StructLayout
from amaranth.lib.wiring import Component, In
from harness import Sequence, opened, proof

from kalmanhdl.rtl.flow import Credits, ResultQueue, SkidBuffer
from kalmanhdl.rtl.issue import Issue, Pace

NUMBERED = StructLayout({"number": 4})
STEP = StructLayout({"track": 1, "command": 2, "number": 4})


class Skid(Component):
    """A skid buffer between any sender and any receiver; ``fault`` sends a token twice."""

    def __init__(self, fault: bool = False) -> None:
        self.fault = fault
        super().__init__({"valid": In(1), "ready": In(1)})

    def elaborate(self, platform):
        m = Module()
        dut = SkidBuffer(NUMBERED)
        m.submodules.dut, inner = opened(dut)
        send, receive = self.valid & dut.i.ready, dut.o.valid & self.ready
        tokens = Sequence.counting(m, send ^ (Const(self.fault) & send & receive), receive)
        m.d.comb += [
            dut.i.valid.eq(self.valid),
            dut.i.payload.number.eq(tokens.sent),
            dut.o.ready.eq(self.ready),
            Assert(~dut.o.valid | (dut.o.payload.number == tokens.received)),
            Assert(tokens.inside == inner["valid"] + inner["held_valid"]),
            # What came in is offered in the clock after: nothing waits unseen.
            Assert(dut.o.valid == (tokens.inside != 0)),
            Assert(~inner["held_valid"] | (inner["held"] == (tokens.received + 1)[:4])),
            Assert(~(inner["held_valid"] & inner["ready"])),
        ]
        before, known = Signal(), Signal()
        m.d.sync += [before.eq(self.ready), known.eq(1)]
        # A receiver that takes what it is offered makes room for the sender, a clock later.
        m.d.comb += Assert(~(before & known) | dut.i.ready)
        return m


def test_a_skid_buffer_loses_doubles_and_holds_nothing():
    found = proof(Skid(), 4, induction=True)
    assert (found.bounded, found.inductive) == (True, True), found.broken


def test_a_token_sent_twice_is_seen():
    assert "Assert failed" in proof(Skid(fault=True), 6).broken


class Queue(Component):
    """Credits, a datapath of some clocks and the queue of results, as a filter wires them.

    ``fault``: the credits believe in one place more than the queue has. ``data``: what is received is seen.
    """

    def __init__(self, depth: int, clocks: int, fault: bool = False, data: bool = False) -> None:
        self.depth, self.clocks, self.fault, self.data = depth, clocks, fault, data
        super().__init__({"start": In(1), "ready": In(1)})

    def elaborate(self, platform):
        m = Module()
        credits, queue = Credits(self.depth + self.fault), ResultQueue(NUMBERED, self.depth)
        m.submodules.credits, given = opened(credits)
        m.submodules.queue, inner = opened(queue)
        go, receive = self.start & credits.available, queue.o.valid & self.ready
        stages = [go, *(Signal(name=f"stage_{k}") for k in range(self.clocks))]
        m.d.sync += [after.eq(before) for before, after in pairwise(stages)]
        write = stages[-1]
        results = Sequence.counting(m, write, receive)
        m.d.comb += [
            credits.take.eq(go),
            credits.give.eq(queue.freed),
            queue.write.eq(write),
            queue.data.number.eq(results.sent),
            queue.o.ready.eq(self.ready),
        ]
        waiting = Signal(4)
        under_way = sum(stages[1:], Const(0))
        m.d.comb += [
            waiting.eq(inner["waiting"] + 1),
            # Every place is spare, promised to a step, full, or on its way back.
            Assert(given["spare"] + 1 + under_way + waiting + inner["freed"] == self.depth),
            Assert((given["spare"] >= -1) & (inner["waiting"] >= -1)),
            Assert(results.inside == (waiting + inner["valid"])[:4]),
            # Results lie in order, each in a place of its own: none is written over before it is read.
            Assert(waiting <= self.depth),
            Assert(inner["write_place"] == results.sent[: len(inner["write_place"])]),
            Assert(inner["read_place"] == (results.received + inner["valid"])[: len(inner["read_place"])]),
            # Nothing gets stuck: what waits is fetched as soon as the output is free.
            Assert(~((waiting != 0) & (~inner["valid"] | self.ready)) | inner["fetch"]),
        ]
        # Where nothing is under way and nothing waits, a step may start.
        idle = (under_way == 0) & (waiting == 0) & ~inner["freed"]
        m.d.comb += Assert(~idle | credits.available)
        if self.data:
            m.d.comb += Assert(~queue.o.valid | (queue.o.payload.number == results.received))
        return m


@pytest.mark.parametrize(("depth", "clocks"), [(2, 1), (4, 1), (4, 3)])
def test_a_queue_with_credits_neither_overflows_nor_gets_stuck(depth, clocks):
    found = proof(Queue(depth, clocks), 3, induction=True)
    assert (found.bounded, found.inductive) == (True, True), found.broken


def test_every_result_is_received_once_and_in_order():
    assert proof(Queue(2, 1, data=True), 12).bounded


def test_a_credit_too_many_is_seen():
    assert "Assert failed" in proof(Queue(2, 1, fault=True), 8).broken


class Issued(Component):
    """Steps of two tracks: issued in order, each once, those of a track far enough apart, none held on."""

    def __init__(self, pace: Pace, apart: int | None = None) -> None:
        self.pace = pace
        self.apart = pace.interval * pace.slots if apart is None else apart
        super().__init__({"valid": In(1), "track": In(1), "room": In(1)})

    def elaborate(self, platform):
        m = Module()
        dut = Issue(STEP, (), self.pace)
        m.submodules.dut, inner = opened(dut)
        steps = Sequence.counting(m, self.valid & dut.i.ready, dut.go)
        m.d.comb += [
            dut.i.valid.eq(self.valid),
            dut.i.payload.track.eq(self.track),
            dut.i.payload.number.eq(steps.sent),
            dut.room.eq(self.room),
            Assert(~dut.go | (dut.next_step.number == steps.received)),
            Assert(~dut.go | self.room),
        ]
        self._apart(m, dut)
        if self.pace.slots > 1:
            self._places(m, inner, steps)
        else:
            m.d.comb += Assert(steps.inside == 0)
        self._goes_on(m, dut)
        return m

    def _apart(self, m, dut):
        """Clocks since each track started, as far as they matter."""
        for track in range(2):
            since = Signal(range(self.apart + 1), init=self.apart, name=f"since_{track}")
            here = dut.go & (dut.next_step.track == track)
            m.d.sync += since.eq(Mux(here, 1, since + (since != self.apart)))
            m.d.comb += Assert(~here | (since == self.apart))

    def _places(self, m, inner, steps):
        second, third = inner["second"], inner["third"]
        there = inner["second_valid"], inner["third_valid"]
        number = Cat(*(third[k] for k in range(3, 7))), Cat(*(second[k] for k in range(3, 7)))
        m.d.comb += [
            Assert(steps.inside == there[0] + there[1]),
            Assert(~there[1] | (number[0] == steps.received)),
            Assert(~there[0] | (number[1] == (steps.received + there[1])[:4])),
            Assert(~(there[0] & there[1]) | (inner["same_track"] == (second[0] == third[0]))),
        ]

    def _goes_on(self, m, dut):
        """With room and steps to come, one is issued at the latest when its track may start again."""
        limit = self.pace.interval * self.pace.slots + self.pace.interval + 3
        waited = Signal(range(limit + 2))
        m.d.sync += waited.eq(Mux(dut.go | ~self.valid | ~self.room, 0, waited + (waited != limit + 1)))
        m.d.comb += Assert(waited < limit)


PACES = [(1, 1), (2, 1), (1, 2), (1, 4), (2, 3)]


@pytest.mark.parametrize(("interval", "slots"), PACES)
def test_steps_are_issued_in_order_once_and_far_enough_apart(interval, slots):
    clocks = 2 * interval * slots + 2 * interval + 8
    found = proof(Issued(Pace(interval=interval, slots=slots)), clocks, induction=True)
    assert (found.bounded, found.inductive) == (True, True), found.broken


def test_steps_that_are_too_near_are_seen():
    found = proof(Issued(Pace(interval=1, slots=2), apart=3), 8)
    assert "Assert failed" in found.broken
