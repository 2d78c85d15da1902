"""Tables of measurements."""

import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.errors import DataError
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.simulate import data
from kalmanhdl.simulate.data import plots_from_arrays, read_plots

DESIGNS = Path(__file__).parents[2] / "designs"

MODEL = linear_model(
    [[1, 1], [0, 1]],
    [[1, 0], [0, 1]],
    np.eye(2),
    np.eye(2),
    B=[[1], [0]],
    initial=given([0, 0], np.eye(2)),
    state_names=["place", "speed"],
    measurement_names=["gps", "wheel"],
    control_names=["pedal"],
)
GOOD = "track,time,gps,wheel,pedal,truth_speed,note\na,0,1,2,3,4,x\nb,0.5,,5,6,,\na,1,7,nan,8,9,y\n"


def read(text, tmp_path, model=MODEL, name="plots.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_plots(path, model)


def test_tracks_stand_side_by_side_with_their_gaps(tmp_path):
    plots = read(GOOD, tmp_path)
    nan = np.nan
    assert plots.tracks == ("a", "b")
    np.testing.assert_array_equal(plots.active, [[True, True], [True, False]])
    np.testing.assert_array_equal(plots.z, [[[1, 2], [nan, 5]], [[7, nan], [nan, nan]]])
    np.testing.assert_array_equal(plots.u[:, :, 0], [[3, 6], [8, 0]])
    np.testing.assert_array_equal(plots.time, [[0, 0.5], [1, nan]])
    np.testing.assert_array_equal(plots.truth, [[[nan, 4], [nan, nan]], [[nan, 9], [nan, nan]]])


def test_a_table_of_one_track_needs_only_its_measurements_and_controls(tmp_path):
    plots = read("pedal,wheel,gps\r\n1,2,3\r\n", tmp_path)
    assert plots.tracks == ("0",)
    np.testing.assert_array_equal(plots.z, [[[3, 2]]])
    assert plots.time is None
    assert plots.truth is None


def test_in_a_table_of_one_column_a_blank_line_is_a_missed_measurement(tmp_path):
    model = linear_model([[1]], [[1]], [[1]], [[1]], initial=given([0], [[1]]), measurement_names=["gps"])
    plots = read("gps\n1\n\n3\n", tmp_path, model)
    np.testing.assert_array_equal(plots.z[:, 0, 0], [1, np.nan, 3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "plots.csv: empty: the first line names the columns"),
        (" , \n", "plots.csv: empty"),
        ("gps,wheel,pedal\n", "plots.csv: no rows of data below the header"),
        ("gsp,wheel,pedal\n1,2,3\n", "no column for the measurement gps: did you mean 'gsp'?"),
        ("gps,wheel,pedl\n1,2,3\n", "no column for the control pedal: did you mean 'pedl'?"),
        ("gps;wheel;pedal\n1;2;3\n", "line 1: the columns are not separated by commas"),
        ("gps;wheel;pedal\n1,5;2,5;3\n", "line 1: the columns are not separated by commas: save it as CSV"),
        ("gps\twheel\tpedal\n1,5\t2,5\t3\n", "commas between cells and points in numbers"),
        ("gps,pedal\n1,2\n", "no column for the measurement wheel: there are gps, pedal"),
        ("gps,peda,pedal\n1,2,3\n", "no column for the measurement wheel: there are gps, peda, pedal"),
        ("gps,wheel,truth_pedal\n1,2,3\n", "'truth_pedal' is the truth of no state: did you mean"),
        (
            "gps,wheel,pedal,truth_speed,truth_spee\n1,2,3,4,5\n",
            "'truth_spee' is the truth of no state: did you mean 'truth_place'",
        ),
        (
            'gps,wheel,pedal\n1,2,3\n1,"2,3\n1,2,3\n1,2,3\n',
            'line 3: its quotes (") do not end: not CSV: unexpected end of data',
        ),
        (
            'gps,wheel,pedal\n1,"2,3\n1,2,3\n1,"2",3\n',
            "line 2: its quotes (\") do not end: not CSV: ',' expected after",
        ),
        ('gps,wheel,pedal\n1,2,"3"x\n', "line 2: not CSV: ',' expected after"),
        ('gps,wheel,pedal\n1,2,"\n3"\n1,x,3\n', "line 4, column wheel: 'x' is no number"),
        ('gps,wheel,pedal\n1,"two\nlines",3\n', "line 2, column wheel: 'two"),
        ("gps,gps,wheel\n1,2,3\n", "line 1: the column 'gps' stands twice"),
        ("gps,wheel,pedal\n1,2,3\n1,two,3\n", "line 3, column wheel: 'two' is no number: write a"),
        ("gps,wheel,pedal\n1,1_0,3\n", "line 2, column wheel: '1_0' is no number"),
        ("gps,wheel,pedal\n1,-inf,3\n", "line 2, column wheel: '-inf' is not finite"),
        ("gps,wheel,pedal\n1,1e999,3\n", "line 2, column wheel: '1e999' is not finite"),
        ("gps,wheel,pedal\n1,2\n", "line 2: 2 cells below a header of 3: give every row 3"),
        ("gps,wheel,pedal\n1,2,\n", "line 2, column pedal: empty: a control is known at every step"),
        ('gps,wheel,pedal\n"1,2,3\n', "line 2: not CSV: unexpected end of data"),
        ("track,gps,wheel,pedal\n,1,2,3\n", "line 2, column track: empty: every row belongs to a track"),
        ("gps,wheel,pedal,truth_sped\n1,2,3,4\n", "did you mean 'truth_speed'?"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "line 1: not UTF-8 text: save the table as CSV in UTF-8"),
        (b"gps,wheel,pedal\n1,2,\xff\n", "line 2: not UTF-8 text"),
        (b"gps,wheel,pedal\n1,2,\x00\n", "plots.csv, line 2"),
        ("g" * 200_000, "not CSV: field larger than field limit"),
        (",".join(f"c{i}" for i in range(5000)), "line 1: 5000 columns: at most 4096"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_its_place(text, message, tmp_path):
    with pytest.raises(DataError) as caught:
        read(text, tmp_path)
    assert message in str(caught.value)


def test_tables_too_large_are_refused_before_they_fill_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(data, "MAX_CELLS", 40)
    with pytest.raises(DataError, match="more than 13 rows: split the file by tracks"):
        read("gps,wheel,pedal\n" + "1,2,3\n" * 14, tmp_path)
    rows = "a,1,2,3\n" * 5 + "b,1,2,3\nc,1,2,3\nd,1,2,3\n"
    with pytest.raises(DataError, match="4 tracks of up to 5 steps"):
        read("track,gps,wheel,pedal\n" + rows, tmp_path)
    monkeypatch.setattr(data, "MAX_BYTES", 10)
    with pytest.raises(DataError, match="at most 10; split the file"):
        read(GOOD, tmp_path)


@pytest.mark.parametrize("path", ["/nowhere/x.csv", ".", "a\0b", "x" * 5000])
def test_paths_that_are_no_files_are_refused(path):
    with pytest.raises(DataError, match="cannot be read"):
        read_plots(path, MODEL)


def test_parquet_reads_the_same_or_says_what_is_missing(tmp_path):
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        with pytest.raises(DataError, match="Parquet needs pyarrow: install it, or save the table as CSV"):
            read_plots(tmp_path / "plots.parquet", MODEL)
        return
    columns = {"track": ["a", "b"], "gps": [1.0, None], "wheel": [2, 3], "pedal": [0.5, 0.25]}
    pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "plots.parquet")
    plots = read_plots(tmp_path / "plots.parquet", MODEL)
    np.testing.assert_array_equal(plots.z, [[[1, 2], [np.nan, 3]]])


def test_arrays_become_plots():
    plots = plots_from_arrays([[1, np.nan], [3, 4]], MODEL, u=[[0], [1]])
    assert plots.z.shape == (2, 1, 2)
    assert plots.active.all()
    assert plots_from_arrays(np.zeros((5, 3, 2)), MODEL, u=np.zeros((5, 3, 1))).tracks == ("0", "1", "2")


@pytest.mark.parametrize(
    ("z", "u", "message"),
    [
        ([[1, 2, 3]], [[0]], "z has shape (1, 3): (steps, 2) or (steps, tracks, 2)"),
        ([[1, 2]], None, "u is missing: the model has 1 control"),
        ([[1, 2]], [[0], [1]], "make them equal"),
        ([[1, 2]], [[np.nan]], "a control is known at every step"),
        ([[1, np.inf]], [[0]], "z has an infinite number"),
        ([["a", "b"]], [[0]], "is no array of real numbers: give floats or integers, NaN where missed"),
        ([["1", "2"]], [[0]], "is no array of real numbers"),
        (np.array([["1", "2"]], "S8"), [[0]], "is no array of real numbers"),
        (np.array([["1", 2.0]], object), [[0]], "is no array of real numbers"),
        (np.array([[1, 2]], "datetime64[s]"), [[0]], "is no array of real numbers"),
        (np.array([[1, 2]], "timedelta64[s]"), [[0]], "is no array of real numbers"),
        ([[1, 2]], np.ma.array([[1.0]], mask=[[True]]), "u has a NaN"),
    ],
)
def test_arrays_that_do_not_suit_the_model_are_refused(z, u, message):
    with pytest.raises(DataError) as caught:
        plots_from_arrays(z, MODEL, u)
    assert message in str(caught.value)


@pytest.mark.parametrize("u", ["x", [[1.0], [2.0]], np.zeros((2, 1, 3))])
def test_controls_of_a_model_without_any_are_refused(u):
    model = linear_model([[1]], [[1]], [[1]], [[1]], initial=given([0], [[1]]))
    with pytest.raises(
        DataError, match=r"u (has shape .*: the model takes none, leave it out|= 'x' is no arr)"
    ):
        plots_from_arrays([[1], [2]], model, u)
    assert plots_from_arrays([[1], [2]], model, np.zeros((2, 0))).u.shape == (2, 1, 0)


def test_what_is_masked_is_missed():
    z = np.ma.array([[1.0, 2.0], [3.0, 4.0]], mask=[[False, True], [False, False]])
    expected = [[1, np.nan], [3, 4]]
    for given_z in (z, z.astype(int), list(z), [[1, None], [3, 4]]):
        np.testing.assert_array_equal(plots_from_arrays(given_z, MODEL, [[0], [0]]).z[:, 0], expected)


def test_times_are_numbers_of_seconds():
    days = np.array(["2026-01-01", "2026-01-02"], "datetime64[D]")
    with pytest.raises(DataError, match="is not 2 numbers of seconds, or 2 x 1"):
        plots_from_arrays([[1, 2], [3, 4]], MODEL, [[0], [0]], time=days)


WORDS = [b"", b",", b'"', b"\n", b"\x00", b"\xff", b"inf", b"1e999", b"=1+1", b"nan", b"x" * 9]


def changed(content, chance):
    """A table with a few bytes or lines replaced, removed, doubled or cut off."""
    lines = content.splitlines(keepends=True)
    for _ in range(chance.randint(1, 4)):
        spot = chance.randrange(len(lines))
        line = lines[spot]
        cut = chance.randrange(len(line))
        word = chance.choice(WORDS)
        lines[spot] = chance.choice([b"", line * 2, line[:cut] + word + line[cut:], line[:cut] + word, word])
        lines = [line for line in lines if line] or [b"\n"]
    return b"".join(lines)


def test_any_changed_table_reads_or_ends_in_one_message_soon(tmp_path):
    chance = random.Random(1)
    for _ in range(1500):
        start = time.process_time()
        try:
            plots = read(changed(GOOD.encode(), chance), tmp_path)
        except DataError as error:
            message = str(error)
        else:
            assert not np.isinf(plots.z).any()
            continue
        assert 0 < len(message) < 1000
        assert "\n" not in message
        assert time.process_time() - start < 2


def velocity_errors(model, plots):
    """RMS errors of the rates, of the filter in doubles and of two-point differences, at the same rows."""
    estimates = np.full(plots.truth.shape, np.nan)
    for track in range(len(plots.tracks)):
        x, P = np.zeros(model.n), np.zeros((model.n, model.n))
        for step in np.flatnonzero(plots.active[:, track]):
            z = plots.z[step, track]
            if step < model.initial.points:
                x = model.initial.x + model.initial.from_measurement @ z + model.initial.from_state @ x
                P = model.initial.P
                continue
            x, P = model.F @ x, model.F @ P @ model.F.T + model.Q
            if not np.isnan(z).any():
                gain = P @ model.H.T @ np.linalg.inv(model.H @ P @ model.H.T + model.R)
                x, P = x + gain @ (z - model.H @ x), P - gain @ model.H @ P
            estimates[step, track] = x
    rates, truth = estimates[1:, :, 1::2], plots.truth[1:, :, 1::2]
    differences = np.diff(plots.z, axis=0) / model.F[0, 1]
    both = ~np.isnan(rates + differences).any(axis=2)
    return [np.sqrt(((found - truth)[both] ** 2).mean(axis=0)) for found in (rates, differences)]


def test_the_filter_halves_the_velocity_error_of_real_radar_plots():
    model = Design.load(DESIGNS / "autoferry_radar.toml").model
    plots = read_plots(DESIGNS / "data" / "autoferry_radar_target.csv", model)
    filtered, differenced = velocity_errors(model, plots)
    assert (filtered < 0.55 * differenced).all()


def test_the_radar_table_is_what_its_script_makes():
    table = DESIGNS / "data" / "autoferry_radar_target.csv"
    before = table.read_bytes()
    script = DESIGNS / "data" / "make_autoferry.py"
    made = subprocess.run([sys.executable, script, "-"], check=True, capture_output=True).stdout
    assert made == before
