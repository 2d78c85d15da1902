"""Drive a free-running core with one set of operands a clock."""

from collections.abc import Iterable, Sequence

from amaranth.hdl import Module
from amaranth.sim import Simulator


def results(
    cores: Sequence, stimuli: Iterable[dict[str, int]], outputs: Sequence[str]
) -> list[list[tuple[int, ...]]]:
    """For every core, its outputs for each stimulus, taken ``core.registers`` clocks after it."""
    stimuli = list(stimuli)
    taken: list[list[tuple[int, ...]]] = [[] for _ in cores]
    deepest = max(core.registers for core in cores)
    m = Module()
    for index, core in enumerate(cores):
        m.submodules[f"core_{index}"] = core

    async def bench(ctx):
        for clock in range(len(stimuli) + deepest):
            for core in cores:
                for name, value in stimuli[min(clock, len(stimuli) - 1)].items():
                    if hasattr(core, name):
                        ctx.set(getattr(core, name), value)
            if deepest == 0:
                await ctx.delay(1e-9)
            for core, values in zip(cores, taken, strict=True):
                if core.registers <= clock and len(values) < len(stimuli):
                    values.append(tuple(ctx.get(getattr(core, name)) for name in outputs))
            if deepest:
                await ctx.tick()

    simulator = Simulator(m)
    if deepest:
        simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return taken
