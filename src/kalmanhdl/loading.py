"""Another model in hardware whose coefficients are loadable: its image, and whether it fits."""

from dataclasses import replace

import numpy as np

from kalmanhdl.design import Design
from kalmanhdl.errors import FormatError
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.floating import FloatNumbers
from kalmanhdl.numerics.image import Word, image, loaded
from kalmanhdl.numerics.integers import Numbers
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.pipeline import Hardware, numbers_of
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.side_by_side import simulate
from kalmanhdl.toolchain.simulators import Simulator, simulate_with
from kalmanhdl.validation import InvalidValueError
from kalmanhdl.verify.border import border_of
from kalmanhdl.verify.compare import Verification
from kalmanhdl.verify.compare import verify as compare
from kalmanhdl.verify.stimulus import Section, from_model, random_sections

# Missed measurements in a row.
_COAST = 5


def image_of(design: Design, model: Model, numbers: Numbers | FloatNumbers | None = None) -> tuple[Word, ...]:
    """The coefficients of a model for the hardware of a design, in the order of their addresses.

    Raises:
        DesignError: the design's coefficients are not loadable.
        ModelError: the model has other sizes, or a number where the hardware's pattern has a zero.
        FormatError: a coefficient does not fit its format, or tracks of the model leave the formats.
    """
    found = numbers or numbers_of(design)
    if not isinstance(found, Numbers) or found.traced is None:
        problem = f' = "{design.architecture.coefficients}": nothing can be loaded: use "loadable"'
        raise InvalidValueError("architecture", "coefficients", problem)
    words = image(found, design.model, model, design.algorithm)
    _check_ranges(design, found, words, model)
    return words


def _check_ranges(design: Design, found: Numbers, words: tuple[Word, ...], model: Model) -> None:
    """Formats rest on tracks of the model that was built for: tracks of this one must stay within, too."""
    drawn = simulated(model, _COAST)
    plots = Plots(
        tracks=tuple(map(str, range(drawn.z.shape[1]))),
        z=np.where(drawn.valid, drawn.z, np.nan),
        u=drawn.u,
        active=drawn.relevant,
        time=None,
        truth=None,
    )
    typed = loaded(found, words)
    filter_ = design.algorithm(model)
    run = simulate(model, filter_, replace(found, typed=typed), plots, optimised=False)
    index, count = max(run.trace.violations.items(), default=(0, 0), key=lambda each: each[1])
    if count:
        raise FormatError(
            f"{typed.graph.origins[index]} leaves {typed.formats[index]} in {count} of "
            f"{int(plots.active.sum())} steps of this model's tracks: build with more [numerics.headroom], "
            "or for the model whose numbers reach furthest"
        )


def verify_image(
    hardware: Hardware,
    model: Model,
    words: tuple[Word, ...],
    steps: int,
    seed: int = 1,
    simulator: Simulator = Simulator.CXXRTL,
) -> tuple[Verification, ...]:
    """The Verilog, after the image of a model was written to it, against the engine; see ``pipeline.verify``.

    Raises VerificationError at the first bit that differs.
    """
    plan, shown, name = hardware.plan, hardware.interface, hardware.design.name
    assert isinstance(hardware.numbers, Numbers)
    typed = loaded(hardware.numbers, words)
    half, tracks = max(1, steps // 2), plan.channels * shown.lanes
    verilog = simulate_with(simulator, hardware.verilog, name, border_of(shown), optimised=False)
    engine = Engine.of(typed, optimised=False)
    runs = {
        "model": (Section(steps=from_model(model, typed, half, tracks, seed)),),
        "random": random_sections(plan, shown, half, seed + 1, typed),
    }
    raws = [word.raw for word in words]
    return tuple(
        compare(verilog, name, plan, shown, engine, sections, stimulus=kind, image=raws)
        for kind, sections in runs.items()
    )
