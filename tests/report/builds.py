"""Builds to report on, by the stages that need no tool, and what tools might have said of them."""

from dataclasses import replace
from pathlib import Path

from kalmanhdl.design import Design, Target
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.pipeline import Hardware, planned, simulate
from kalmanhdl.report.record import Record
from kalmanhdl.rtl.interface import interface
from kalmanhdl.simulate.data import read_plots
from kalmanhdl.toolchain.nextpnr import Hop, Implementation

DESIGNS = Path(__file__).parents[2] / "designs"


def hardware(design: Design) -> Hardware:
    """A design without its Verilog, for the device of the tests."""
    design = replace(design, target=Target(device="unit", grade=1))
    typed = numbers(design.model, design.algorithm, design.numerics)
    plan = planned(design, typed)
    return Hardware(
        design=design,
        numbers=typed,
        plan=plan,
        interface=interface(plan),
        verilog="",
        seconds={"trace": 1.0, "schedule": 2.0},
    )


def record_of(name: str, data: str | None) -> Record:
    made = hardware(Design.load(DESIGNS / f"{name}.toml"))
    plots = read_plots(DESIGNS / "data" / data, made.design.model) if data else None
    simulation = simulate(made.design, plots, made.numbers) if plots else None
    return Record(hardware=made, simulation=simulation)


def placement(seed: int, fmax: float) -> Implementation:
    return Implementation(
        device="unit",
        grade=1,
        seed=seed,
        tool="nextpnr of a test",
        fmax_mhz=fmax,
        luts=1000 + seed,
        ffs=2000,
        multipliers=10,
        block_rams=6,
        seconds=12.5,
        critical_path=(Hop(kind="logic", cell="<add & carry>", port="A0", net="n", delay_ns=1.25),),
    )
