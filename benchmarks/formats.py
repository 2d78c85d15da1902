"""How many candidate formats are tried a second: the same compiled engine, the formats being data.

    python benchmarks/formats.py [DESIGN ...]

A candidate is a width for each signal, run over 64 tracks and compared with the float reference. Every one is
another: none is compiled, none is remembered.
"""

import sys
import time

import numpy as np

from kalmanhdl.design import Design
from kalmanhdl.explore.choice import place_forms, variables_of
from kalmanhdl.explore.format_engine import FormatEngine
from kalmanhdl.explore.program import program_of
from kalmanhdl.explore.tracks import drawn_plots, drive_of, judged, usual_steps
from kalmanhdl.numerics.integers import in_reals

DESIGNS = ("designs/lee1997.toml", "designs/dcmkf_radar.toml", "designs/wu2012.toml")
TRACKS, SECONDS = 64, 5.0


def main() -> None:
    print("design            signals  candidates/s  steps/s (one core, by its own time)")
    for path in sys.argv[1:] or DESIGNS:
        design = Design.load(path)
        reals = in_reals(design.model, design.algorithm, design.fixed_point)
        program = program_of(reals.graph, reals.ranges)
        plots = drawn_plots(design.model, design.fixed_point.coast, usual_steps(design.model), TRACKS, 1)
        on = judged(design.model, design.algorithm(design.model), plots)
        names = [f"x[{i}]" for i in range(design.model.n)]
        engine = FormatEngine.of(program, design.fixed_point, names)
        drive, variables = drive_of(program, reals.scaling, on), variables_of(program, {})
        scales = np.array([reals.scales[name] for name in names])
        base, random, count = engine.forms(design.fixed_point), np.random.default_rng(1), 0
        begin = time.process_time()
        while time.process_time() - begin < SECONDS:
            widths = random.integers(20, 40, len(variables))
            run = engine.run(place_forms(base, program, variables, widths), 24, drive)
            on.excess(np.moveaxis(run.outputs, 0, -1) * scales)
            count += 1
        rate = count / (time.process_time() - begin)
        print(f"{design.name:16} {len(variables):8} {rate:13.0f} {rate * drive.commands.size:10.3g}")


if __name__ == "__main__":
    main()
