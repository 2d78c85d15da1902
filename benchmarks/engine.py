"""Steps per second and core of the bit-exact engine, beside filterpy and simdkalman.

The filter is that of designs/lee1997.toml: four states, two independent axes, 16-bit formats, two
reciprocals a step, 1000 tracks; for wider signals that of designs/lee1997_q12_20.toml, 32-bit formats with
64-bit products and exact divisions. In floating point it is lee1997 in single and double precision, and in
single precision rounded toward zero, which processors do not offer beside the other; and designs/wu2012.toml
in single precision, nine dense states and spherical measurements. A step is one update of one track. The
engine gives estimates, variances, innovations and NIS of every step, and where the table says so all states
too; it is called as users call it, with integers in memory, and its results are new arrays each time.
Run: ``python benchmarks/engine.py``. Times are processor time, summed over threads, the best of many short
runs: what else the machine does slows all but the luckiest. The last row is a loop of NumPy's that never
changes, by which two runs of this table compare.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import simdkalman
from filterpy.kalman import KalmanFilter
from rich.console import Console
from rich.table import Table

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.design import Design
from kalmanhdl.numerics.floating import FloatSpecification, float_numbers
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.side_by_side import stimulus_of

DESIGNS = Path(__file__).parents[1] / "designs"

TRACKS, STEPS = 1000, 250
# Every rate is the best of as many runs as take so many seconds, and of no fewer than so many.
SECONDS, RUNS = 0.6, 5
F = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
H = np.kron(np.eye(2), [[1.0, 0.0]])
Q, R = np.diag([0, 1 / 64, 0, 1 / 64]), np.eye(2) / 4


def rate(run: Callable[[], object], steps: int) -> float:
    """Steps per second of processor time, the best of several runs."""
    seconds: list[float] = []
    while sum(seconds) < SECONDS or len(seconds) < RUNS:
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return steps / min(seconds)


def fixed_rate() -> float:
    """Square roots of doubles in the cache, by NumPy."""
    values, rounds = np.linspace(1.0, 2.0, 1000), 200

    def run() -> None:
        for _ in range(rounds):
            np.sqrt(values, out=values)

    return rate(run, rounds * len(values))


def engine_rates(design_name: str, z: np.ndarray) -> dict[str, float]:
    """The engine as it is called: checks, copies and results included."""
    design = Design.load(DESIGNS / f"{design_name}.toml")
    engine = Engine.of(numbers(design.model, design.algorithm, design.numerics).typed)
    inputs = {f"z[{axis}]": np.ascontiguousarray(z[:, :, axis]) for axis in range(2)}
    flags = {f"valid[{axis}]": np.ones((STEPS, TRACKS), bool) for axis in range(2)}
    flags["initialise"] = np.zeros((STEPS, TRACKS), bool)
    flags["initialise"][:2] = True
    variants = {
        f"engine, {design_name}": {"record_states": False},
        f"engine, {design_name}, all states kept": {},
        f"engine, {design_name}, monitored": {"record_states": False, "monitor": True},
    }
    return {
        name: rate(lambda options=options: engine.run(inputs, flags, **options), TRACKS * STEPS)
        for name, options in variants.items()
    }


def float_rates() -> dict[str, float]:
    """The engine in floating point, on plots of the design's own units."""
    single = FloatSpecification(exponent=8, mantissa=23)
    variants = {
        "lee1997, float32": ("lee1997", single, STEPS),
        "lee1997, float64": ("lee1997", FloatSpecification(exponent=11, mantissa=52), STEPS),
        "lee1997, float32 toward zero": ("lee1997", replace(single, rounding=Rounding.TOWARD_ZERO), STEPS),
        "wu2012, float32": ("wu2012", single, 50),
    }
    rates = {}
    for name, (design_name, specification, steps) in variants.items():
        design = Design.load(DESIGNS / f"{design_name}.toml")
        typed = float_numbers(design.model, design.algorithm, specification).typed
        drawn = simulated(design.model, coast=0, steps=steps, tracks=TRACKS)
        given = stimulus_of(design.model, typed, plots_from_arrays(drawn.z, design.model))
        engine = Engine.of(typed)
        run = partial(engine.run, given.inputs, given.flags, record_states=False)
        rates[f"engine, {name}"] = rate(run, TRACKS * steps)
    return rates


def filterpy_rate(z: np.ndarray) -> float:
    """One filter object for one track, as filterpy works."""
    steps = 250
    filter_ = KalmanFilter(dim_x=4, dim_z=2)
    filter_.F, filter_.H, filter_.Q, filter_.R = F, H, Q, R

    def run() -> None:
        for k in range(steps):
            filter_.predict()
            filter_.update(z[k, 0])

    return rate(run, steps)


def simdkalman_rate(z: np.ndarray) -> float:
    """All tracks in vectors; without smoothing, only the filtered states kept."""
    steps = 50
    data = np.ascontiguousarray(z[:steps].transpose(1, 0, 2))
    filter_ = simdkalman.KalmanFilter(
        state_transition=F, process_noise=Q, observation_model=H, observation_noise=R
    )
    arguments = {
        "initial_value": np.zeros(4),
        "initial_covariance": np.eye(4),
        "filtered": True,
        "smoothed": False,
        "states": True,
        "observations": False,
    }
    return rate(lambda: filter_.compute(data, 0, **arguments), TRACKS * steps)


def main() -> None:
    """Measure all and print the table."""
    # Targets that stand still, in plots as noisy as the design expects: about 130 units of the last bit.
    raw = np.random.default_rng(1).normal(8000, 130, (STEPS, TRACKS, 2)).astype(np.int64)
    real = raw / 2.0**13
    rates = engine_rates("lee1997", raw) | engine_rates("lee1997_q12_20", raw << 12)
    rates |= float_rates()
    rates |= {"simdkalman": simdkalman_rate(real), "filterpy": filterpy_rate(real)}
    rates |= {"square roots of NumPy, to compare runs": fixed_rate()}
    table = Table("", "M steps/s and core", "times slower than the first")
    fastest = next(iter(rates.values()))
    for name, value in rates.items():
        table.add_row(name, f"{value / 1e6:.4f}", f"{fastest / value:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
