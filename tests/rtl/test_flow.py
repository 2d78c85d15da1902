"""Streams: nothing is lost or doubled, whatever the two sides do; and when steps start."""

from itertools import pairwise
from random import Random

import pytest
from amaranth.hdl import Module, signed
from amaranth.lib.data import StructLayout
from amaranth.sim import Simulator

from kalmanhdl.rtl.flow import Credits, ResultQueue, SkidBuffer, queue_depth
from kalmanhdl.rtl.issue import Issue, Pace

LAYOUT = StructLayout({"track": 3, "command": 2, "z_0": signed(8), "present_0": 1})


def drive(m, dut, bench):
    simulator = Simulator(m or dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()


@pytest.mark.parametrize(("gaps", "holds"), [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)])
def test_a_skid_buffer_passes_every_token_once_and_in_order(gaps, holds):
    dut, random, given, taken = SkidBuffer(LAYOUT), Random(3), [], []

    async def bench(ctx):
        offered = False
        for clock in range(300):
            if not offered and random.random() >= gaps:
                offered = True
                ctx.set(dut.i.payload, {"track": clock % 8, "z_0": clock % 100})
            ctx.set(dut.i.valid, offered)
            before = ctx.get(dut.i.ready)
            ready = random.random() >= holds
            ctx.set(dut.o.ready, ready)
            assert ctx.get(dut.i.ready) == before  # ready is a register
            if offered and before:
                offered = False
                given.append(ctx.get(dut.i.payload.z_0))
            if ready and ctx.get(dut.o.valid):
                taken.append(ctx.get(dut.o.payload.z_0))
            await ctx.tick()

    drive(None, dut, bench)
    assert taken == given[: len(taken)]
    assert len(given) - len(taken) <= 2
    if not gaps and not holds:
        assert len(taken) >= 297


@pytest.mark.parametrize("depth", [2, 4, 16])
def test_a_queue_with_credits_never_overflows(depth):
    queue, credit, random = ResultQueue(LAYOUT, depth), Credits(depth), Random(depth)
    m = Module()
    m.submodules += [queue, credit]
    m.d.comb += credit.give.eq(queue.freed)
    sent, taken = [], []

    async def bench(ctx):
        for clock in range(400):
            write = bool(ctx.get(credit.available)) and random.random() < 0.8
            ctx.set(credit.take, write)
            ctx.set(queue.write, write)
            ctx.set(queue.data, {"z_0": clock % 100})
            if write:
                sent.append(clock % 100)
            ready = random.random() < (0.9 if clock < 200 else 0.3)
            ctx.set(queue.o.ready, ready)
            if ready and ctx.get(queue.o.valid):
                taken.append(ctx.get(queue.o.payload.z_0))
            await ctx.tick()

    drive(m, None, bench)
    assert taken == sent[: len(taken)]
    assert len(sent) - len(taken) <= depth + 1


@pytest.mark.parametrize(("interval", "slots"), [(1, 1), (1, 2), (1, 3), (1, 9), (3, 1), (3, 2), (2, 5)])
def test_steps_of_a_track_start_in_slots_far_enough_apart(interval, slots):
    dut, random = Issue(LAYOUT, ("present_0",), Pace(interval=interval, slots=slots)), Random(slots)
    tracks = [random.choice((0, 1, random.randrange(8))) for _ in range(150)]
    starts = []

    async def bench(ctx):
        index = 0
        for clock in range(150 * interval * slots + 50):
            ctx.set(dut.room, random.random() < 0.9)
            ctx.set(dut.i.valid, index < len(tracks))
            if index < len(tracks):
                ctx.set(dut.i.payload, {"track": tracks[index], "command": 1, "present_0": 1})
                index += ctx.get(dut.i.ready)
            if ctx.get(dut.go):
                starts.append((clock, ctx.get(dut.next_step.track)))
            await ctx.tick()
            if ctx.get(dut.valid):
                assert ctx.get(dut.step.present_0) == 0  # a prediction

    drive(None, dut, bench)
    assert [track for _, track in starts] == tracks
    assert len({clock % interval for clock, _ in starts}) == 1
    for track in range(8):
        own = [clock for clock, other in starts if other == track]
        assert all(b - a >= interval * slots for a, b in pairwise(own))


def test_the_queue_holds_what_is_on_the_way():
    assert queue_depth(1, 0) == 4
    assert queue_depth(1, 20) == 32
    assert queue_depth(24, 20) == 2
