"""One core, three filters: loaded one after the other into the same simulated Verilog, on measured altitudes.

    python benchmarks/three_filters.py [--rows 200] [--multipliers 9]

The altitude of a small rotary UAV by GPS, every second. Engine, instruction-set simulator and Verilog are
compared bit for bit; the double-precision reference is the one of all designs.
"""

import argparse
import csv
import time
from pathlib import Path

import numpy as np

from kalmanhdl.algorithm import Conventional, Taylor
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.model.initial import given, three_point, two_point
from kalmanhdl.model.motion import constant_acceleration, constant_velocity
from kalmanhdl.model.singer import singer
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import compiled, rows_read, tokens
from kalmanhdl.processor.compiler.trace import traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.rtl_simulation import Peripherals, RtlSimulation
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.verification import compare
from kalmanhdl.processor.verilog import core_verilog
from kalmanhdl.simulate.commands import commands, started
from kalmanhdl.simulate.reference import reference

SIZE = 3
DATA = Path(__file__).parents[1] / "designs" / "data" / "uav" / "UAV_Rot.csv"
SIGMA_M = 3.0
# Above half of what a missed row makes of the covariance, so that the expansion converges.
POINT = ((40.0, 0.0, 0.0), (0.0, 8.0, 0.0), (0.0, 0.0, 1.0))


def filters():
    """Name, model and algorithm."""
    velocity = constant_velocity(T=1.0, noise=0.5)
    manoeuvre = singer(T=1.0, tau=5.0, noise=1.0)
    acceleration = constant_acceleration(T=1.0, noise=0.3)
    starts = {"constant velocity": two_point(), "Singer": three_point(), "Taylor": None}
    motions = {"constant velocity": velocity, "Singer": manoeuvre, "Taylor": acceleration}
    for name, motion in motions.items():
        n = len(motion.F)
        initial = starts[name] or given(np.zeros(n), np.diag([9.0, 4.0, 1.0]))
        H = np.eye(n)[:1]
        model = linear_model(motion.F, H, motion.Q, [[SIGMA_M**2]], initial=initial)
        yield name, model, Taylor(POINT) if name == "Taylor" else Conventional()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=200)
    parser.add_argument("--multipliers", type=int, default=0, help="0: eight clocks an instruction")
    asked = parser.parse_args()
    rows = asked.rows
    core = Core(form=Fixed(width=32, fraction=18), extended=True, units=asked.multipliers // SIZE)
    with DATA.open() as file:
        altitude = np.array([float(row["altitude (m)"]) for row in csv.DictReader(file)][:rows])
    z = (altitude - altitude[0])[:, None]
    z[100] = np.nan
    machine = Machine(core, *bench(core, ()))
    with RtlSimulation(core, core_verilog(core), optimised=False) as rtl:
        for name, model, algorithm in filters():
            print(f"{name}: {one(rtl, machine, model, algorithm, z)}", flush=True)


def one(rtl, machine, model, algorithm, z):
    begin = time.perf_counter()
    core = machine.core
    filter_ = traced(model, algorithm, core.size)
    program = compiled(filter_, core)
    given_ = rows_read(core, z)
    engine = Engine(filter_, core)
    wanted = np.array([engine.step(row) for row in given_])
    read = tokens(filter_, core, given_)
    machine.source, machine.sink = bench(core, read)
    machine.load(program.words)
    done = run(machine, 10_000_000)
    differing = int((np.array(done.sent).reshape(wanted.shape) != wanted).sum())
    clocks = machine.clock / len(z)
    equal = compare(core, rtl, machine, program.words, Peripherals(tokens=read), done.instructions)
    cube = z[:, None]
    issued = commands(model, cube, np.ones(cube.shape[:2], bool))
    exact = reference(algorithm(model), issued, cube, np.zeros((len(z), 1, 0))).x[:, 0]
    running = started(model, issued)[:, 0]
    apart = np.abs(wanted[:, : model.n] * float(core.form.resolution) - exact)[running].max()
    return (
        f"{len(program.words)} words, {len(z)} rows: {differing} of {wanted.size} outputs differ between"
        f" engine and simulator, 0 of {equal} values between simulator and Verilog; at most {apart:.1e} off "
        f"double precision; {clocks:.0f} clocks a row; {time.perf_counter() - begin:.0f} s"
    )


if __name__ == "__main__":
    main()
