"""The format engine against the bit-exact one: equal outputs under equal formats."""

from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.design import Design
from kalmanhdl.explore.format_engine import Drive, FormatEngine
from kalmanhdl.explore.program import program_of
from kalmanhdl.graph.operations import Input
from kalmanhdl.numerics.integers import in_reals
from kalmanhdl.numerics.quantise import quantise
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.side_by_side import raw
from random_designs import random_design

LEE = Design.load("designs/lee1997.toml")
STEPS, TRACKS = 30, 40
# Sums and products beyond this are no longer exact on doubles.
EXACT_BITS = 53


def run_both(reals, program, specification, seed):
    """Outputs of both engines on random inputs, and the widest value of the exact one."""
    typed = quantise(reals.graph, reals.ranges, specification, reals.scales)
    random = np.random.default_rng(seed)
    reach = {
        o.name: max(-reals.ranges.low[k], reals.ranges.high[k])
        for k, o in enumerate(reals.graph.operations)
        if isinstance(o, Input)
    }
    inputs = {name: random.uniform(-reach[name], reach[name], (STEPS, TRACKS)) for name in program.inputs}
    flags = {name: random.random((STEPS, TRACKS)) < 0.7 for name in program.flags}
    flags["initialise"][:] = False
    flags["initialise"][:3] = True
    engine = Engine.of(typed)
    forms = dict(zip(typed.graph.operations, typed.formats, strict=True))
    raws = {port.name: raw(inputs[port.name], forms[Input(port.name)])[0] for port in engine.program.inputs}
    trace = engine.run(raws, {port.name: flags[port.name] for port in engine.program.flags})
    quick = FormatEngine.of(program, specification)
    drive = Drive(
        inputs=np.stack([inputs[name] for name in program.inputs]),
        flags=np.stack([flags[name] for name in program.flags]).astype(np.uint8),
        commands=np.full((STEPS, TRACKS), 2, np.uint8),
    )
    run = quick.run(quick.forms(specification), specification.form("constant"), drive)
    roots = dict(typed.graph.outputs)
    exact = np.stack(
        [np.ldexp(trace.outputs[n].astype(float), -typed.formats[roots[n]].fraction) for n in quick.outputs]
    )
    widest = max(form.width for form in typed.formats if form is not None)
    return run, exact, widest, sum(trace.violations.values())


def prepared(design):
    reals = in_reals(design.model, design.algorithm, design.numerics)
    return reals, program_of(reals.graph, reals.ranges)


@pytest.mark.parametrize("width", [6, 9, 12, 16, 20, 26])
def test_uniform_widths_give_what_the_exact_engine_gives(width):
    reals, program = prepared(LEE)
    specification = replace(LEE.numerics, width=width)
    run, exact, widest, violations = run_both(reals, program, specification, width)
    assert widest <= EXACT_BITS
    np.testing.assert_array_equal(run.outputs, exact)
    # A value that only one of two later choices takes counts here as well.
    assert (run.clamped.sum() > 0) >= (violations > 0)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(16))
def test_random_designs_give_what_the_exact_engine_gives(seed):
    design = random_design(seed, max_states=4)
    run, exact, widest, violations = run_both(*prepared(design), design.numerics, seed)
    assert (run.clamped.sum() > 0) >= (violations > 0)
    if widest <= EXACT_BITS:
        np.testing.assert_array_equal(run.outputs, exact)
    else:
        # A last bit now and then, which saturation can carry on.
        assert np.mean(run.outputs == exact) > 0.5


def test_headroom_moves_binary_points_as_in_the_exact_engine():
    reals, program = prepared(LEE)
    headroom = {"P[0,1]": 3, "gain": 2, "reciprocal": 1}
    specification = replace(LEE.numerics, headroom=headroom)
    run, exact, _, _ = run_both(reals, program, specification, 5)
    np.testing.assert_array_equal(run.outputs, exact)
    plain, _, _, _ = run_both(reals, program, LEE.numerics, 5)
    assert not np.array_equal(run.outputs, plain.outputs)


def test_a_format_of_a_signal_is_kept():
    reals, program = prepared(LEE)
    signals = {"P[0,1]": 11, "K[1,0]": 9, "x[0]": 14}
    specification = replace(LEE.numerics, signals=signals)
    run, exact, _, _ = run_both(reals, program, specification, 3)
    np.testing.assert_array_equal(run.outputs, exact)
    plain, _, _, _ = run_both(reals, program, LEE.numerics, 3)
    assert not np.array_equal(run.outputs, plain.outputs)


def test_a_track_counts_no_further_after_its_first_clamped_value():
    reals, program = prepared(LEE)
    short = replace(LEE.numerics, signals={"x[0]": Fixed(width=20, fraction=22)})
    run, _, _, violations = run_both(reals, program, short, 7)
    names = {program.slots[program.steps[k].slot].name for k in np.flatnonzero(run.beyond)}
    assert 0 < run.clamped.sum() < violations
    assert "x[0]" in names
    assert (run.beyond <= run.clamped).all()
