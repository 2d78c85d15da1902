"""The algorithms run on floats, against values that others computed or that are exact."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.algorithm import ALGORITHMS
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.simulate.commands import Command, commands, started
from kalmanhdl.simulate.reference import reference
from linear_models import EXACT

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(params=sorted(EXACT))
def algorithm(request):
    return ALGORITHMS[request.param]()


def _table(name):
    with (DATA / name).open() as file:
        return list(csv.DictReader(file))


def _numbers(rows, *columns):
    return np.array([[float(row[c]) if row[c] else np.nan for c in columns] for row in rows])


def _estimates(model, algorithm, z, u=None):
    z = z[:, None, :]
    u = np.zeros((*z.shape[:2], 0)) if u is None else u[:, None, :]
    return reference(algorithm(model), commands(model, z, np.ones(z.shape[:2], bool)), z, u)


def test_the_robot_of_pykalman_is_tracked_as_matlab_does(algorithm):
    facts = json.loads((DATA / "pykalman_robot/model.json").read_text())
    inputs = _table("pykalman_robot/inputs.csv")
    model = linear_model(
        facts["A"],
        facts["C"],
        facts["Q"],
        facts["R"],
        initial=given(facts["x0"], facts["P0"]),
        B=np.eye(5),
        measurement_offset=facts["d"],
    )
    controls = _numbers(inputs, *(f"b{i}_from_prev" for i in range(1, 6)))
    found = _estimates(model, algorithm, _numbers(inputs, "z1", "z2"), controls)
    expected = _table("pykalman_robot/expected_filtered.csv")
    np.testing.assert_allclose(
        found.x[:500, 0], _numbers(expected, *(f"x{i}" for i in range(1, 6))), rtol=0, atol=1e-9
    )
    rows, columns = np.triu_indices(5)
    names = [f"P{i + 1}{j + 1}" for i, j in zip(rows, columns, strict=True)]
    np.testing.assert_allclose(
        found.P[:500, 0][:, rows, columns], _numbers(expected, *names), rtol=0, atol=1e-9
    )


def test_the_flow_of_the_nile_is_filtered_to_ten_digits(algorithm):
    rows = _table("nile_local_level_50digits.csv")
    level = _numbers(rows, "a_pred", "v").sum(axis=1, keepdims=True)
    model = linear_model([[1.0]], [[1.0]], [[1469.1]], [[15099.0]], initial=given([0.0], [[1e7]]))
    found = _estimates(model, algorithm, level)
    np.testing.assert_allclose(found.x[:, 0, 0], _numbers(rows, "a_filt")[:, 0], rtol=1e-10)
    np.testing.assert_allclose(found.P[:, 0, 0, 0], _numbers(rows, "P_filt")[:, 0], rtol=1e-10)
    nis = _numbers(rows, "v")[:, 0] ** 2 / _numbers(rows, "F")[:, 0]
    np.testing.assert_allclose(found.nis[:, 0], nis, rtol=1e-9)


def test_the_radar_of_bozic_has_its_covariances_and_gains(algorithm):
    T, s1 = 15.0, 330.75
    F = np.kron(np.eye(2), [[1.0, T], [0.0, 1.0]])
    H = np.kron(np.eye(2), [[1.0, 0.0]])
    R = np.diag([1e6, 0.017**2])
    model = linear_model(F, H, np.diag([0, s1, 0, s1 / 160e3**2]), R, initial=two_point())
    rows = _table("bozic1979_radar_50digits.csv")
    count = max(int(row["k"]) for row in rows)
    found = _estimates(model, algorithm, np.zeros((count, 2)))
    K = found.P[:, 0] @ H.T @ np.linalg.inv(R)
    compared = 0
    for row in rows:
        k, i, j = (int(row[name]) - 1 for name in ("k", "row", "col"))
        values = {"P_filt": found.P[:, 0], "K_filter": K}
        if row["quantity"] in values:
            exact = float(row["value"])
            assert values[row["quantity"]][k, i, j] == pytest.approx(exact, rel=1e-9, abs=0.0), row
            compared += 1
    assert compared > 500


def test_a_missed_measurement_only_predicts(algorithm):
    F = np.array([[1.0, 1.0], [0.0, 1.0]])
    Q = np.diag([0.1, 0.2])
    model = linear_model(F, [[1.0, 0.0]], Q, [[2.0]], initial=given([1.0, 0.5], np.eye(2)))
    found = _estimates(model, algorithm, np.array([[1.2], [np.nan], [3.0]]))
    np.testing.assert_allclose(found.x[1, 0], F @ found.x[0, 0], rtol=1e-14)
    np.testing.assert_allclose(found.P[1, 0], F @ found.P[0, 0] @ F.T + Q, rtol=1e-14)
    assert found.innovation[1, 0, 0] == 0
    assert found.nis[1, 0] == 0


def test_one_missed_component_leaves_the_update_by_the_others(algorithm):
    random = np.random.default_rng(3)
    root = random.standard_normal((3, 3))
    F, H = 0.9 * np.eye(3) + 0.1 * root, random.standard_normal((2, 3))
    R = np.array([[1.0, 0.4], [0.4, 2.0]])
    start = given(np.ones(3), np.eye(3))
    both = linear_model(F, H, np.eye(3), R, initial=start)
    first = linear_model(F, H[:1], np.eye(3), R[:1, :1], initial=start)
    z = random.standard_normal((6, 2))
    z[:, 1] = np.nan
    found, expected = _estimates(both, algorithm, z), _estimates(first, algorithm, z[:, :1])
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-12)
    np.testing.assert_allclose(found.P, expected.P, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-12)


def test_a_track_starts_with_the_first_two_complete_rows():
    model = linear_model([[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.eye(2), [[1.0]], initial=two_point())
    z = np.array([[1.0], [np.nan], [2.0], [3.5], [np.nan], [5.0]])[:, None]
    found = commands(model, z, np.ones((6, 1), bool))
    none, start, predict, update = Command.NONE, Command.INITIALISE, Command.PREDICT, Command.UPDATE
    assert list(found[:, 0]) == [none, none, start, start, predict, update]
    assert list(started(model, found)[:, 0]) == [False, False, False, True, True, True]


def test_a_belief_before_the_first_row_is_predicted_by_that_rows_controls(algorithm):
    F, B = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])
    x, P, Q = np.array([1.0, -0.5]), np.diag([2.0, 1.0]), 0.1 * np.eye(2)
    start = given(x, P, at="before_first")
    model = linear_model(F, [[1.0, 0.0]], Q, [[1.0]], initial=start, B=B, offset=[0.1, 0.2])
    found = _estimates(model, algorithm, np.array([[np.nan]]), np.array([[3.0]]))
    np.testing.assert_allclose(found.x[0, 0], F @ x + B[:, 0] * 3.0 + [0.1, 0.2], rtol=1e-14)
    np.testing.assert_allclose(found.P[0, 0], F @ P @ F.T + Q, rtol=1e-14)
