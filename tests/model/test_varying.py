"""Models whose matrices are formulas in run-time inputs."""

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.design_file import dumps, loads
from kalmanhdl.errors import DataError, DesignError, ModelError
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.varying import varying_model
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.simulate.data import plots_from_arrays, read_plots
from random_designs import random_varying_model
from test_design_file import assert_same

DT = RunTimeInput(name="dt", low=0.5, high=4.0, from_time=True)
F = [[1, "dt"], [0, 1]]
Q = [["dt^3/3", "dt^2/2"], ["dt^2/2", "dt"]]

FILE = """
name = "timed"
[model]
kind = "linear"
state = ["position", "speed"]
measurement = ["seen"]
control = ["push"]
F = [[1, "dt"], [0, 1]]
H = [[1, 0]]
B = [["dt^2/2"], ["dt"]]
Q = [["q*dt^3/3", "q*dt^2/2"], ["q*dt^2/2", "q*dt"]]
R = [["noise*r"]]
constants = { q = 0.5, longest = 4 }
[model.inputs]
dt = { range = [0.5, "longest"], from = "time" }
noise = [1, 9]
[model.initial]
kind = "given"
x = [0, 0]
P = [[1, 0], [0, 1]]
"""


def model(**changes):
    keys = {"initial": given([0, 0], np.eye(2)), "inputs": [DT], **changes}
    return varying_model(keys.pop("F", F), [[1, 0]], keys.pop("Q", Q), keys.pop("R", [[2.0]]), **keys)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"F": [[1, "dtt"], [0, 1]]}, r"F\[0,1\]: the name 'dtt' is unknown: did you mean 'dt'"),
        ({"R": [["2 - dt"]]}, r"R where dt = 4: R\[0,0\] = -2: a variance is greater than 0"),
        ({"Q": [["dt", 0], [0, "dt - 1"]]}, r"Q where dt = 0.5: Q\[1,1\] = -0.5"),
        ({"F": [[1, "1/(dt - 4)"], [0, 1]]}, r"F is no finite number"),
        ({"initial": two_point()}, r"\[model.initial\] kind: this start rests on what varies"),
        ({"initial": given([0, 0], np.eye(2), at="before_first")}, "this start rests on what varies"),
        ({"inputs": [RunTimeInput(name="dt", low=4, high=4)]}, r"dt = \[4, 4\]: the first must be less"),
        ({"inputs": [DT, RunTimeInput(name="x0", low=0, high=1)]}, "x0 has another meaning in this model"),
        (
            {"inputs": [DT, RunTimeInput(name="t", low=0, high=1, from_time=True)]},
            'dt is from = "time" already',
        ),
        ({"F": [[1, "dt"]]}, "F is not 2 x 2"),
        ({"F": [[1, "dt*push"], [0, 1]], "control_names": ["push"], "B": [[0], [1]]}, "push is a control"),
    ],
)
def test_what_cannot_be_is_said(changes, message):
    with pytest.raises(ModelError, match=message):
        model(**changes)


@pytest.mark.parametrize("kind", ["scheduled", "taylor"])
def test_algorithms_that_rest_on_constants_refuse(kind):
    with pytest.raises(
        DesignError, match='does not suit a time-varying model: use "conventional" or "joseph"'
    ):
        Design(name="no", model=model(), algorithm=kind)


def test_a_file_says_the_same_and_comes_back_from_its_text():
    design = loads(FILE.replace("*r", ""))
    assert design.model.control_names == ("push", "dt", "noise")
    assert_same(loads(dumps(design)), design)
    with pytest.raises(DesignError, match=r"line 12: \[model\] R\[0,0\]: the name 'r' is unknown"):
        loads(FILE)


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ('from = "time"', 'from = "clock"', r"line 15: \[model.inputs\] dt|is no input: write a range like"),
        ("noise = [1, 9]", "noise = 3", "is no list"),
        ('kind = "linear"', 'kind = "singer"', "write its matrices by formulas"),
    ],
)
def test_a_wrong_input_in_a_file_names_its_place(wrong, right, message):
    with pytest.raises(DesignError, match=message):
        loads(FILE.replace("*r", "").replace(wrong, right))


def test_formulas_are_worked_out_in_any_units():
    m = loads(FILE.replace("*r", "")).model
    u = np.array([2.0, 3.0, 4.0])
    step = m.at(u.astype(object))
    np.testing.assert_allclose(step.F.astype(float), [[1, 3], [0, 1]])
    np.testing.assert_allclose(step.Q.astype(float), 0.5 * np.array([[9, 4.5], [4.5, 3]]))
    np.testing.assert_allclose(step.R.astype(float), [[4]])
    np.testing.assert_allclose(step.transition(np.array([1.0, 1.0], object), u).astype(float), [13, 7])


def test_the_time_since_the_row_before_comes_from_the_column_time(tmp_path):
    file, m = tmp_path / "plots.csv", model()
    file.write_text("track,time,z0\na,10,1\nb,5,1\na,12,\nb,6,2\nb,9.5,3\n")
    plots = read_plots(file, m)
    assert plots.u[:, :, 0].T.tolist() == [[0.5, 2.0, 0.0], [0.5, 1.0, 3.5]]
    file.write_text("time,z0,dt\n10,1,1\n19,1,1.5\n")
    assert read_plots(file, m).u[:, 0, 0].tolist() == [1.0, 1.5]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("z0\n1\n", "no column for the time, from which dt follows"),
        ("time,z0\n1,1\n9,1\n", r"line 3, column time: dt = 8 is outside of \[0.5, 4\]: widen its range"),
        ("time,z0\n1,1\n,1\n", "line 3, column time: empty"),
        ("z0,dt\n1,1\n1,5\n", r"line 3, column dt: dt = 5 is outside of \[0.5, 4\]"),
    ],
)
def test_data_without_a_time_that_can_be_is_refused(tmp_path, text, message):
    (tmp_path / "plots.csv").write_text(text)
    with pytest.raises(DataError, match=message):
        read_plots(tmp_path / "plots.csv", model())


def test_arrays_take_the_time_or_the_input_itself():
    z, m = np.ones((3, 1)), model()
    by_time = plots_from_arrays(z, m, time=[0, 2, 3])
    by_input = plots_from_arrays(z, m, [[0.5], [2], [1]])
    np.testing.assert_array_equal(by_time.u, by_input.u)
    with pytest.raises(DataError, match=r"step 1 of track 0: dt = 9 is outside of \[0.5, 4\]"):
        plots_from_arrays(z, m, time=[0, 9, 10])
    with pytest.raises(DataError, match="one for each row of z"):
        plots_from_arrays(z, m, time=[0, 1])
    with pytest.raises(DataError, match="u is missing"):
        plots_from_arrays(z, m)


def test_tracks_that_formats_rest_on_reach_the_corners_of_the_limits():
    m = model()
    dt = simulated(m, coast=5).u[..., 0]
    assert dt.min() == 0.5
    assert dt.max() == 4.0
    assert (dt == 4.0).all(axis=0).any()
    assert ((dt > 0.5) & (dt < 4.0)).any()


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_drawn_tracks_is_that_of_each_step(seed):
    random = np.random.default_rng(seed)
    m = random_varying_model(random)
    u = np.broadcast_to(simulated(m, coast=5).u[3, 1], (20_000, m.p))
    errors = m.measurement_errors(u, random.standard_normal((20_000, m.m)))
    R = m.at(u[0].astype(object)).R.astype(float)
    np.testing.assert_allclose(np.cov(errors.T).reshape(m.m, m.m), R, atol=0.06 * np.abs(R).max())
