"""Extended filters as programs: engine and simulator agree on every bit, and both follow the reference."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.design import Processor
from kalmanhdl.design_file import loads
from kalmanhdl.errors import DesignError
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.processor.checks import drawn_rows, verified
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import compiled, tokens
from kalmanhdl.processor.compiler.trace import traced
from kalmanhdl.processor.fit import fitted
from kalmanhdl.processor.follow import as_data, follow, rows_of
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.verilog import core_verilog

RADAR = (Path(__file__).parents[3] / "designs" / "ekf_radar.toml").read_text()
RADAR = RADAR[: RADAR.index("[architecture]")] + '[architecture]\nkind = "processor"\n'
# Controls, a state that is an angle, rows of f and h that are no formulas beside some that are, noise that
# turns with the heading, measurements whose errors are correlated.
ROVER = """
name = "rover"
[model]
kind = "nonlinear"
state = ["x", "y", "heading", "speed"]
measurement = ["range", "bearing", "odometer"]
control = ["yaw_rate"]
f = ["x + T*speed*cos(heading)", "y + T*speed*sin(heading)", "heading + T*yaw_rate", "speed"]
h = ["sqrt((x-bx)^2 + (y-by)^2)", "atan2(by - y, bx - x) - heading", "speed + 0.25"]
angles = ["bearing", "heading"]
G = [["T*cos(heading)", 0], ["T*sin(heading)", 0], [0, "T"], [1, 0]]
Q = { diagonal = [0.04, 0.0004] }
R = [[0.25, 0.002, 0], [0.002, 0.0004, 0], [0, 0, 0.01]]
measurement_range = [[1, 120], ["-pi", "pi"], [-5, 5]]
constants = { T = 0.5, bx = 40.0, by = -30.0 }
[model.initial]
kind = "given"
x = [0, 0, 0, 1]
P = { diagonal = [4, 4, 0.1, 0.25] }
[algorithm]
kind = "extended"
joseph = true
[numerics]
rounding = "half_even"
[architecture]
kind = "processor"
"""


@pytest.fixture(scope="module", params=[RADAR, ROVER], ids=["radar", "rover"])
def fit(request):
    return fitted(loads(request.param))


@pytest.fixture(scope="module")
def plots(fit):
    return as_data(simulated(fit.given, 2, 40, 6, seed=7))


def test_its_estimates_are_those_of_double_precision(fit, plots):
    found = follow(fit.filter_, fit.core, fit.given, fit.design.algorithm, fit.scaling, plots)
    assert found.saturations == 0
    deviations = np.sqrt(np.diagonal(found.reference.P, axis1=2, axis2=3))
    off = np.abs(found.exact.x - found.reference.x) / deviations
    assert np.nanmax(off) < 0.01
    assert np.nanmedian(off) < 1e-4
    P = np.abs(found.exact.P - found.reference.P) / (deviations[..., None] * deviations[..., None, :])
    assert np.nanmax(P) < 0.01


@pytest.mark.parametrize("short", [False, True], ids=["one section", "apart"])
@pytest.mark.parametrize("units", [0, 4], ids=["eight clocks", "pipelined"])
def test_engine_and_simulator_agree_on_every_bit(fit, plots, short, units):
    core = replace(fit.core, units=units)
    filter_ = traced(fit.model, fit.algorithm, core.size, short=short)
    rows = rows_of(core, fit.given, fit.scaling, plots)[1]
    engine = Engine(filter_, core)
    wanted = [number for row in rows for number in engine.step(row)]
    machine = Machine(core, *bench(core, tokens(filter_, core, rows)))
    machine.load(compiled(filter_, core).words)
    assert list(run(machine, 1_000_000).sent) == wanted
    # Nor does anything saturate that nobody reads.
    assert not machine.saturated
    assert not engine.saturated


def test_a_core_has_the_functions_that_its_filter_needs(fit):
    names = {each.value for each in fit.core.functions}
    assert {"sine", "cosine", "wrap", "arctangent"} <= names
    assert "exponential" not in names


@pytest.mark.slow
@pytest.mark.parametrize("multipliers", [0, 16])
def test_the_verilog_is_the_engine_too(multipliers):
    fit = fitted(replace(loads(RADAR), processor=Processor(multipliers=multipliers)))
    found = verified(fit, core_verilog(fit.core), (), drawn_rows(fit, 60), 60)
    assert [one.steps for one in found] == [60, 20]


def test_run_time_inputs_have_no_program():
    text = ROVER.replace("T = 0.5, bx", "bx")
    text = text.replace(
        "[model.initial]", '[model.inputs.T]\nrange = [0.25, 1.0]\ncolumn = "T"\n[model.initial]'
    ).replace('\ncolumn = "T"', "")
    with pytest.raises(DesignError, match="the run-time inputs T have no program"):
        fitted(loads(text))


@pytest.mark.parametrize(
    ("processor", "message"),
    [
        (Processor(width=12), r"width = 12: no place of the point holds the filter's numbers"),
        (Processor(width=8), r"scales by two to the power 3, which is no number of fixed\(8, fraction=4\)"),
    ],
    ids=lambda each: getattr(each, "width", ""),
)
def test_words_that_are_too_short_are_refused(processor, message):
    with pytest.raises(DesignError, match=message):
        fitted(replace(loads(RADAR), processor=processor))
