"""Random steps for a filter, what they must give, and a driver for its streams in Amaranth's simulator."""

from dataclasses import dataclass, replace
from random import Random

from amaranth.sim import Simulator

from kalmanhdl.graph.operations import State, StateFlag
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.filter import Filter
from kalmanhdl.rtl.interface import INITIALISE_FLAG, Command, Interface, interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.interpreter import interpret


@dataclass(frozen=True)
class Given:
    """One step: its track, its command, and raw integers for the ports of ``Interface``."""

    track: int
    command: int
    ports: dict[str, int]


def random_steps(plan: Plan, count: int, random: Random, tracks: list[int] | None = None) -> list[Given]:
    """Steps with any command and any inputs, for given tracks or in any order of them."""
    shown = interface(plan)
    steps = []
    for k in range(count):
        ports = {p.name: random.randint(p.form.lowest, p.form.highest) for p in shown.numbers}
        ports |= {p.name: random.getrandbits(1) for p in shown.present}
        track = tracks[k % len(tracks)] if tracks else random.randrange(plan.channels)
        steps.append(Given(track, random.choice((0, 1, 2, 2, 2, 3)), ports))
    return steps


def expected(plan: Plan, steps: list[Given]) -> tuple[list[dict[str, int]], list[dict[str, int]]]:
    """For each step its results by port, with track and command, and the new states by name."""
    typed, shown = plan.typed, interface(plan)
    graph = typed.graph
    zeros = {o.name: 0 for o in graph.operations if isinstance(o, State | StateFlag)}
    states = [dict(zeros) for _ in range(plan.channels)]
    results, written = [], []
    for step in steps:
        values = interpret(typed, _named(shown, step), states[step.track]).values
        written.append({name: values[root] for name, root in graph.states})
        states[step.track].update(written[-1])
        outputs = {p.name: values[root] for p, (_, root) in zip(shown.outputs, graph.outputs, strict=True)}
        results.append({"out_command": step.command, **_track(plan, step.track), **outputs})
    return results, written


def _named(shown: Interface, step: Given) -> dict[str, int]:
    measures = step.command in (Command.INITIALISE, Command.UPDATE)
    return {
        INITIALISE_FLAG: int(step.command == Command.INITIALISE),
        **{p.signal: step.ports[p.name] for p in shown.numbers},
        **{p.signal: step.ports[p.name] & measures for p in shown.present},
    }


def _track(plan: Plan, track: int) -> dict[str, int]:
    return {"out_track": track} if plan.channels > 1 else {}


def observable(typed: TypedGraph) -> TypedGraph:
    """The same graph with every new state put out as well."""
    graph = typed.graph
    shown = tuple((f"new[{k}]", root) for k, (_, root) in enumerate(graph.states))
    return replace(typed, graph=replace(graph, outputs=(*graph.outputs, *shown)))


def well_formed(typed: TypedGraph) -> bool:
    """Whether every state that is read is written."""
    read = {o.name for o in typed.graph.operations if isinstance(o, StateFlag)}
    return read <= dict(typed.graph.states).keys()


@dataclass(frozen=True)
class Run:
    """What came out, in order, and the clocks in which steps went in and results came out."""

    results: list[dict[str, int]]
    accepted_at: list[int]
    given_at: list[int]


def run(plan: Plan, steps: list[Given], random: Random, gaps: float = 0.0, holds: float = 0.0) -> Run:
    """Drive a filter; in each clock the sender pauses, or the receiver holds back, with a probability."""
    dut, shown = Filter(plan), interface(plan)
    names = ["out_command", *(["out_track"] if plan.channels > 1 else []), *(p.name for p in shown.outputs)]
    outcome = Run([], [], [])
    limit = 400 + len(steps) * (4 * plan.distance + 8) * 2

    async def bench(ctx):
        offered = False
        for clock in range(limit):
            index = len(outcome.accepted_at)
            if index < len(steps) and not offered and random.random() >= gaps:
                offered = True
                _offer(ctx, dut, steps[index])
            ctx.set(dut.in_valid, offered)
            ready = random.random() >= holds
            ctx.set(dut.out_ready, ready)
            if offered and ctx.get(dut.in_ready):
                outcome.accepted_at.append(clock)
                offered = False
            if ready and ctx.get(dut.out_valid):
                outcome.results.append({name: ctx.get(getattr(dut, name)) for name in names})
                outcome.given_at.append(clock)
            await ctx.tick()
            if len(outcome.results) == len(steps) and clock > outcome.given_at[-1] + 30:
                return

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return outcome


def _offer(ctx, dut: Filter, step: Given) -> None:
    ctx.set(dut.in_command, step.command)
    if hasattr(dut, "in_track"):
        ctx.set(dut.in_track, step.track)
    for name, value in step.ports.items():
        ctx.set(getattr(dut, name), value)
