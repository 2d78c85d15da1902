"""The issue of steps: when a step that came may start on the datapath."""

from dataclasses import dataclass

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import stream
from amaranth.lib.data import StructLayout, View
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.rtl.interface import Command
from kalmanhdl.schedule.plan import Plan


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """When steps may be issued: in one cycle, a slot, of every ``interval``.

    The same track may be issued again ``slots`` slots later, no sooner.
    """

    interval: int
    slots: int


def pace(plan: Plan) -> Pace:
    """The pace of a plan."""
    return Pace(interval=plan.interval, slots=-(-plan.distance // plan.interval))


class Issue(Component):
    """Starts steps on the datapath, each in a cycle in which it may, in the order in which they came.

    ``go`` tells that ``next_step`` is issued; in the cycle after, which is cycle 0 of the step, ``valid`` is
    high, and it stands in ``step`` until the next may be issued. ``room`` promises a place in the queue of
    results for one step. A prediction has its measurements, the fields ``present``, taken away.
    """

    def __init__(self, layout: StructLayout, present: tuple[str, ...], pace: Pace) -> None:
        self._layout = layout
        self._present = present
        self._pace = pace
        super().__init__(
            {
                "i": In(stream.Signature(layout)),
                "room": In(1),
                "go": Out(1),
                "next_step": Out(layout),
                "valid": Out(1),
                "step": Out(layout),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        tick = self._tick(m)
        if self._pace.slots > 1:
            self._issue_checked(m, tick)
        else:
            m.d.comb += [
                self.next_step.eq(self.i.payload),
                self.go.eq(self.i.valid & self.room & tick),
                self.i.ready.eq(self.go),
            ]
        self._enter(m, tick)
        return m

    def _enter(self, m: Module, tick: Value) -> None:
        """The step stands until another may be issued."""
        entered, step = Signal(), Signal(self._layout, reset_less=True)
        m.d.sync += entered.eq(self.go)
        command = self.next_step.command
        measures = (command == Command.INITIALISE) | (command == Command.UPDATE)
        with m.If(tick):
            m.d.sync += step.eq(self.next_step)
            m.d.sync += [step[field].eq(self.next_step[field] & measures) for field in self._present]
        m.d.comb += [self.valid.eq(entered), self.step.eq(step)]

    def _tick(self, m: Module) -> Value:
        """High in the cycles in which a step may be issued."""
        interval = self._pace.interval
        if interval == 1:
            return Const(1)
        phase = Signal(range(interval))
        tick = Signal()
        last = phase == interval - 1
        m.d.sync += [phase.eq(Mux(last, 0, phase + 1)), tick.eq(last)]
        return tick

    def _issue_checked(self, m: Module, tick: Value) -> None:
        """Hold a step back while a step of the same track, issued before, is too near.

        Three registered places, for speed: the step that enters is compared with the tracks of the last
        slots; in the second place it stands with the outcome; in the third with the one bit that says
        whether it is blocked. Bit k of an outcome means k + 1 slots ago, so outcomes move on with every
        slot, and a step issued meanwhile enters at bit 0.
        """
        second, third = _Place("second", self._layout), _Place("third", self._layout)
        back = self._pace.slots - 1
        # What is known of a place is taken with it: without a step in it, it means nothing.
        second_match = Signal(back, reset_less=True)
        third_match = Signal(back, reset_less=True)
        same_track = Signal(reset_less=True)
        blocked = Signal(reset_less=True)
        advance = Signal()
        m.d.comb += [
            self.next_step.eq(third.payload),
            self.go.eq(third.valid & ~blocked & self.room & tick),
            advance.eq(~third.valid | self.go),
            self.i.ready.eq(advance),
        ]

        def older(match: Value) -> Value:
            return Mux(tick, (match << 1)[:back], match)

        entering = self._matches(m, tick, back)
        with m.If(advance):
            again = self.go & same_track
            m.d.sync += [
                *second.take(self.i.valid, self.i.payload),
                second_match.eq(older(entering) | (self.go & _same(self.i.payload, third.payload))),
                *third.take(second.valid, second.payload),
                third_match.eq(older(second_match) | again),
                blocked.eq(older(second_match).any() | again),
                same_track.eq(_same(self.i.payload, second.payload)),
            ]
        with m.Else():
            m.d.sync += [
                second_match.eq(older(second_match)),
                third_match.eq(older(third_match)),
                blocked.eq(older(third_match).any()),
            ]

    def _matches(self, m: Module, tick: Value, back: int) -> Value:
        """Compare the entering step with the steps issued in each of the last slots."""
        issued_valid, issued, matches = self.go, self.next_step, []
        for slot in range(1, back + 1):
            past = _Place(f"issued_{slot}", self._layout, "track")
            with m.If(tick):
                m.d.sync += past.take(issued_valid, issued)
            matches.append(past.valid & _same(self.i.payload, past.payload))
            issued_valid, issued = past.valid, past.payload
        return Cat(*matches)


class _Place:
    """A register for a step, or for some of its fields, that may be empty."""

    def __init__(self, name: str, layout: StructLayout, *fields: str) -> None:
        kept = {field: member.shape for field, member in layout if not fields or field in fields}
        self._fields = tuple(kept)
        self.valid = Signal(name=f"{name}_valid")
        self.payload = Signal(StructLayout(kept), name=name, reset_less=True)

    def take(self, valid: Value, payload: View) -> list[object]:
        fields = [self.payload[field].eq(payload[field]) for field in self._fields]
        return [self.valid.eq(valid), *fields]


def _same(a: View, b: View) -> Value:
    """Whether two steps are of the same track; without a track field there is only one."""
    if "track" not in a.shape().members:
        return Const(1)
    return a.track == b.track
