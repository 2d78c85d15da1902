"""The datapath of a plan: every operation in its cycle, and registers for values that are needed later."""

from amaranth.hdl import Module, Value
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.graph.operations import State, StateFlag
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.rtl.float_values import FloatValues
from kalmanhdl.rtl.interface import INITIALISE_FLAG, Command, Interface
from kalmanhdl.rtl.layouts import result_layout, shape, step_layout
from kalmanhdl.rtl.names import identifier
from kalmanhdl.rtl.shared_unit import SharedUnit
from kalmanhdl.rtl.timeline import Phases, Timeline
from kalmanhdl.rtl.turns import take_turns
from kalmanhdl.rtl.values import Values
from kalmanhdl.schedule.plan import Plan


def result_cycle(plan: Plan) -> int:
    """The cycle of a step in which all its outputs are there."""
    return max((plan.end(index) for _, index in plan.typed.graph.outputs), default=0)


class Datapath(Component):
    """All operations of a step, free running: a step may enter in every clock.

    Cycle 0 of a step is the one in which ``valid`` is high and ``step`` holds its inputs. A state's value
    is taken from the port ``<state>`` in the cycle in which its operation starts; its new value is on
    ``next_<state>`` in the cycle in which its root is there. ``valid_c<n>`` and ``track_c<n>`` tell of the
    step that is in cycle n, for each n in ``valid_cycles`` and ``track_cycles``. The outputs are in
    ``result``, with ``result_valid``, in ``result_cycle(plan)``.
    """

    def __init__(
        self,
        plan: Plan,
        interface: Interface,
        valid_cycles: tuple[int, ...] = (),
        track_cycles: tuple[int, ...] = (),
    ) -> None:
        self._plan = plan
        self._interface = interface
        self._valid_cycles = valid_cycles
        self._track_cycles = track_cycles
        formats = plan.typed.formats
        super().__init__(
            {
                "valid": In(1),
                "step": In(step_layout(interface)),
                **{port.field: In(shape(port.form)) for port in interface.coefficients},
                **{identifier(name): In(shape(formats[index])) for name, index in _states(plan)},
                **{f"next_{identifier(s.state)}": Out(shape(s.form)) for s in interface.states},
                **{f"valid_c{cycle}": Out(1) for cycle in valid_cycles},
                **{f"track_c{cycle}": Out(interface.track_width) for cycle in track_cycles},
                "result_valid": Out(1),
                "result": Out(result_layout(interface)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        states = {name: getattr(self, identifier(name)) for name, _ in _states(self._plan)}
        units = tuple(SharedUnit(self._plan, number) for number in range(len(self._plan.units)))
        phases = Phases(m, self._plan.interval, max((unit.turns for unit in units), default=1))
        kind = FloatValues if isinstance(self._plan.typed, FloatGraph) else Values
        values = kind(m, phases, self._plan, self._inputs(), states, units)
        for number, unit in enumerate(units):
            m.submodules[f"{unit.kind}_{number}"] = unit
            take_turns(m, phases, values, unit, f"{unit.kind}_{number}")
        for name, root in self._plan.typed.graph.states:
            m.d.comb += getattr(self, f"next_{identifier(name)}").eq(values.at(root, self._plan.end(root)))
        self._connect_results(m, phases, values)
        phases.finish()
        return m

    def _inputs(self) -> dict[str, Value]:
        ports = (*self._interface.numbers, *self._interface.present)
        initialise = self.step.command == Command.INITIALISE
        kept = {port.signal: getattr(self, port.field) for port in self._interface.coefficients}
        return {INITIALISE_FLAG: initialise} | {p.signal: self.step[p.field] for p in ports} | kept

    def _connect_results(self, m: Module, phases: Phases, values: Values) -> None:
        last = result_cycle(self._plan)
        valid = Timeline(m, phases, "valid", self.valid, 0, reset=True)

        def there(cycle: int) -> Value:
            # A copy of the valid bit stands for an interval; the step is in a cycle for one clock.
            return (
                valid.at(cycle) & phases.active(cycle) if cycle and phases.interval > 1 else valid.at(cycle)
            )

        m.d.comb += [getattr(self, f"valid_c{cycle}").eq(there(cycle)) for cycle in self._valid_cycles]
        m.d.comb += self.result_valid.eq(there(last))
        stands = self._plan.interval - 1
        for field in ("track", "command")[self._interface.track_width == 0 :]:
            tag = Timeline(m, phases, field, self.step[field], 0, last=stands)
            m.d.comb += self.result[field].eq(tag.at(last))
            if field == "track":
                m.d.comb += [getattr(self, f"track_c{c}").eq(tag.at(c)) for c in self._track_cycles]
        for port, (_, root) in zip(self._interface.outputs, self._plan.typed.graph.outputs, strict=True):
            m.d.comb += self.result[port.field].eq(values.at(root, last))


def _states(plan: Plan) -> list[tuple[str, int]]:
    operations = enumerate(plan.typed.graph.operations)
    return [(o.name, index) for index, o in operations if isinstance(o, State | StateFlag)]
