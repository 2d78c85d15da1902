"""Tables of measurements: CSV or Parquet, one column per measurement, one row per track and step."""

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.errors import DataError
from kalmanhdl.model.checks import reals
from kalmanhdl.model.inputs import RunTimeInput, outside
from kalmanhdl.model.model import Model
from kalmanhdl.validation import close, nearest, shown

Array = NDArray[np.float64]

MAX_BYTES = 1 << 30
MAX_ROWS = 20_000_000
MAX_CELLS = 100_000_000
MAX_COLUMNS = 4096


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plots:
    """The measurements of tracks, side by side.

    z (steps, tracks, m) holds NaN where a measurement is missed, u (steps, tracks, p) the controls,
    ``active`` (steps, tracks) is False past a track's last row. ``time`` (steps, tracks), in seconds, and
    ``truth`` (steps, tracks, n), NaN where unknown, are None where the table has none.
    """

    tracks: tuple[str, ...]
    z: Array
    u: Array
    active: NDArray[np.bool_]
    time: Array | None
    truth: Array | None


def read_plots(path: str | Path, model: Model) -> Plots:
    """The plots of a CSV or Parquet file (by its suffix) for a model.

    Columns: the measurements and controls by name, run-time inputs among them, but for one that follows
    from ``time``; optional ``track``, ``time`` (s) and ``truth_<state>``; others are left alone. An empty
    cell, or ``nan``, is a missed measurement. Rows of a track stand in the order of time.

    Raises:
        DataError: a column is missing, a cell is no number or infinite, rows are ragged, time runs back
            within a track, a run-time input is outside of its limits, or the file is empty, unreadable or
            too large; the message names file, line, column and value.
    """
    source = Path(path)
    name = shown(str(path))[1:-1]
    table = _parquet(source, name) if source.suffix.lower() in (".parquet", ".pq") else _csv(source, name)
    if table.rows == 0:
        raise DataError(f"{name}: no rows of data below the header: give one row a step")
    return _arranged(table, model)


def plots_from_arrays(
    z: ArrayLike, model: Model, u: ArrayLike | None = None, time: ArrayLike | None = None
) -> Plots:
    """The plots of arrays: z (steps, m) for one track or (steps, tracks, m), NaN or masked where missed;
    u alike.

    ``time`` (steps,) or (steps, tracks), in seconds. Where a run-time input follows from it, u has all
    other columns.

    Raises:
        DataError: a shape that does not suit the model, an infinite number, a control that is missing,
            controls of a model without any, a run-time input outside of its limits.
    """
    measured = _cube("z", z, model.m)
    times = None if time is None else _times(time, measured.shape[:2])
    timed = None if times is None else _timed(model)
    wanted = model.p - (timed is not None)
    if u is None and wanted:
        raise DataError(f"u is missing: the model has {wanted} control{'s' * (wanted > 1)}")
    controls = np.zeros((*measured.shape[:2], 0)) if u is None else _cube("u", u, wanted)
    if controls.shape[:2] != measured.shape[:2]:
        raise DataError(
            f"u is for {controls.shape[:2]} steps and tracks, z for {measured.shape[:2]}: make them equal"
        )
    if timed is not None and times is not None:
        passed = np.diff(times, axis=0, prepend=np.nan)
        controls = np.insert(controls, timed, _from_first(model, timed, passed), axis=2)
    if np.isnan(controls).any():
        raise DataError("u has a NaN: a control is known at every step")
    wrong = outside(model.inputs, controls)
    if wrong is not None:
        (step, track), each = wrong
        value = controls[step, track, model.control_names.index(each.name)]
        raise DataError(f"step {step} of track {track}: {_beyond(each, value)}")
    steps, tracks = measured.shape[:2]
    return Plots(
        tracks=tuple(map(str, range(tracks))),
        z=measured,
        u=controls,
        active=np.ones((steps, tracks), dtype=bool),
        time=times,
        truth=None,
    )


def _times(time: ArrayLike, shape: tuple[int, int]) -> Array:
    try:
        times = reals(time)
        times = np.array(np.broadcast_to(times[:, None] if times.ndim == 1 else times, shape))
    except (TypeError, ValueError, OverflowError):
        problem = f"{shape[0]} numbers of seconds, or {shape[0]} x {shape[1]}"
        raise DataError(f"time = {shown(time)} is not {problem}: one for each row of z") from None
    if not np.isfinite(times).all():
        raise DataError("time has a number that is not finite: every row has its time")
    return times


def _timed(model: Model) -> int | None:
    """The place in u of the run-time input that is the time since the row before."""
    first = model.p - len(model.inputs)
    return next((first + k for k, each in enumerate(model.inputs) if each.from_time), None)


def _from_first(model: Model, timed: int, passed: Array) -> Array:
    """The time since the row before; a track's first row has none, and uses none."""
    return np.where(np.isnan(passed), model.inputs[timed - model.p].low, passed)


def _beyond(each: RunTimeInput, value: float) -> str:
    limits = f"[{shown(each.low)}, {shown(each.high)}]"
    remedy = "widen its range, or begin a new track there" if each.from_time else "widen its range"
    return f"{each.name} = {shown(float(value))} is outside of {limits}: {remedy}"


def _cube(name: str, value: ArrayLike, last: int) -> Array:
    try:
        result = reals(value)
    except (TypeError, ValueError, OverflowError):
        problem = "is no array of real numbers: give floats or integers, NaN where missed"
        raise DataError(f"{name} = {shown(value)} {problem}") from None
    shape = result.shape
    if result.ndim == 2:
        result = result[:, None, :]
    if result.ndim != 3 or result.shape[2] != last or 0 in result.shape[:2]:
        rule = f"(steps, {last}) or (steps, tracks, {last})" if last else "the model takes none, leave it out"
        raise DataError(f"{name} has shape {shape}: {rule}")
    if np.isinf(result).any():
        raise DataError(f"{name} has an infinite number: numbers are finite, NaN a missed measurement")
    return result


@dataclass(frozen=True, slots=True)
class _Table:
    """Columns of raw cells; ``line(row)`` is where a row stands in the file."""

    name: str
    columns: dict[str, Sequence[object]]
    rows: int
    line: Callable[[int], str]

    def numbers(self, column: str) -> Array:
        """A column as floats, NaN where its cells are empty."""
        cells = self.columns[column]
        result = np.empty(self.rows)
        for row, cell in enumerate(cells):
            value = _number(cell)
            if value is None or math.isinf(value):
                rule = "write a finite number, or leave the cell empty"
                problem = "is no number" if value is None else "is not finite"
                raise DataError(f"{self.place(row, column)}: {shown(cell)} {problem}: {rule}")
            result[row] = value
        return result

    def place(self, row: int, column: str) -> str:
        """Where a cell stands."""
        return f"{self.name}, {self.line(row)}, column {column}"


def _number(cell: object) -> float | None:
    """The float in a cell, NaN for an empty one, None for anything else."""
    if cell is None:
        return math.nan
    if isinstance(cell, str):
        text = cell.strip()
        if not text:
            return math.nan
        try:
            return None if "_" in text else float(text)
        except ValueError:
            return None
    if isinstance(cell, bool) or not isinstance(cell, int | float):
        return None
    try:
        return float(cell)
    except OverflowError:
        return math.inf


def _csv(path: Path, name: str) -> _Table:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise DataError(f"{name}: {size} bytes: at most {MAX_BYTES}; split the file by tracks")
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DataError(f"{name}: cannot be read: {reason}") from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DataError(f"{name}, line {line}: not UTF-8 text: save the table as CSV in UTF-8") from None
    return _parsed_csv(text, name)


def _parsed_csv(text: str, name: str) -> _Table:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    # The line in which the next row begins: with quotes, its cells may run on over several.
    line = 1
    lines: list[int] = []
    # One flat list: a million small ones would keep the garbage collector busy for seconds.
    cells: list[str] = []
    try:
        header = _header(next(reader, []), name)
        if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
            rule = "save it as CSV, with commas between cells and points in numbers"
            raise DataError(f"{name}, line 1: the columns are not separated by commas: {rule}")
        line = reader.line_num + 1
        for row in reader:
            first, line = line, reader.line_num + 1
            if not row and len(header) == 1:
                row = [""]
            if not row:
                continue
            if len(row) != len(header):
                problem = f"{len(row)} cells below a header of {len(header)}"
                raise DataError(f"{name}, line {first}: {problem}: give every row {len(header)}")
            cells.extend(row)
            lines.append(first)
            if len(lines) > MAX_ROWS or len(cells) > MAX_CELLS:
                raise DataError(f"{name}: more than {len(lines) - 1} rows: split the file by tracks")
    except csv.Error as error:
        where = f'line {line}: its quotes (") do not end' if reader.line_num > line else f"line {line}"
        raise DataError(f"{name}, {where}: not CSV: {error}") from None
    columns: dict[str, Sequence[object]] = {
        column: cells[k :: len(header)] for k, column in enumerate(header)
    }
    return _Table(name, columns, len(lines), lambda row: f"line {lines[row]}")


def _header(cells: list[str], name: str) -> list[str]:
    header = [cell.strip() for cell in cells]
    if not any(header):
        raise DataError(f"{name}: empty: the first line names the columns")
    if len(header) > MAX_COLUMNS:
        raise DataError(f"{name}, line 1: {len(header)} columns: at most {MAX_COLUMNS}")
    if len(set(header)) < len(header):
        twice = next(column for column in header if header.count(column) > 1)
        raise DataError(f"{name}, line 1: the column {shown(twice)} stands twice: rename or remove one")
    return header


def _parquet(path: Path, name: str) -> _Table:
    try:
        import pyarrow.parquet  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError:
        raise DataError(f"{name}: Parquet needs pyarrow: install it, or save the table as CSV") from None
    try:
        table = pyarrow.parquet.read_table(path)
        if table.num_rows > MAX_ROWS or table.num_rows * table.num_columns > MAX_CELLS:
            raise DataError(f"{name}: {table.num_rows} rows: split the file by tracks")
        columns = {str(column): table[column].to_pylist() for column in table.column_names}
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{name}: no Parquet table: {shown(str(error))}") from None
    _header(list(columns), name)
    return _Table(name, columns, table.num_rows, lambda row: f"row {row + 1}")


def _arranged(table: _Table, model: Model) -> Plots:
    truths = _truth_columns(table, model)
    measured = [_required(table, name, "measurement", model) for name in model.measurement_names]
    ids, track, step = _places(table)
    controls = _controls(table, model, track, step)
    times = table.numbers("time") if "time" in table.columns else None
    if times is not None:
        _check_order(table, ids, track, times)
    shape = (int(step.max()) + 1, len(ids))
    cells = shape[0] * shape[1] * (model.m + model.p + len(truths) + 2)
    if cells > MAX_CELLS:
        problem = f"{shape[1]} tracks of up to {shape[0]} steps are {cells} cells side by side"
        raise DataError(
            f"{table.name}: {problem}: at most {MAX_CELLS}; give tracks of alike length a file each"
        )

    def spread(columns: Sequence[Array]) -> Array:
        result = np.full((*shape, len(columns)), np.nan)
        for k, column in enumerate(columns):
            result[step, track, k] = column
        return result

    active = np.zeros(shape, dtype=bool)
    active[step, track] = True
    return Plots(
        tracks=ids,
        z=spread(measured),
        u=np.nan_to_num(spread(controls)),
        active=active,
        time=None if times is None else spread([times])[:, :, 0],
        truth=spread(truths) if truths else None,
    )


def _controls(table: _Table, model: Model, track: NDArray[np.int64], step: NDArray[np.int64]) -> list[Array]:
    """The columns of controls and run-time inputs, one of which may follow from the column ``time``."""
    timed, first = _timed(model), model.p - len(model.inputs)
    found = []
    for k, name in enumerate(model.control_names):
        derived = k == timed and name not in table.columns
        what = f"time, from which {name} follows," if derived else "control" if k < first else "input"
        place = "time" if derived else name
        column = _required(table, place, what, model)
        missing = np.flatnonzero(np.isnan(column))
        if len(missing):
            raise DataError(f"{table.place(int(missing[0]), place)}: empty: a control is known at every step")
        found.append(_from_first(model, k, _passed(column, track, step)) if derived else column)
        wrong = outside(model.inputs[k - first : k - first + 1], found[-1][:, None]) if k >= first else None
        if wrong is not None:
            (row,), each = wrong
            raise DataError(f"{table.place(row, place)}: {_beyond(each, found[-1][row])}")
    return found


def _passed(times: Array, track: NDArray[np.int64], step: NDArray[np.int64]) -> Array:
    """The time that passed since the row before of the same track, NaN for its first row."""
    passed = np.full(len(times), np.nan)
    order = np.lexsort((step, track))
    same = np.diff(track[order]) == 0
    passed[order[1:][same]] = np.diff(times[order])[same]
    return passed


def _check_order(table: _Table, ids: tuple[str, ...], track: NDArray[np.int64], times: Array) -> None:
    """Within a track time runs on; it is the order of the rows that the filter follows."""
    rows = np.flatnonzero(~np.isnan(times))
    rows = rows[np.argsort(track[rows], kind="stable")]
    before, after = rows[:-1], rows[1:]
    back = (track[before] == track[after]) & (times[after] < times[before])
    if back.any():
        k = int(np.flatnonzero(back)[np.argmin(after[back])])
        row, earlier = int(after[k]), int(before[k])
        of_track = f" of track {shown(ids[track[row]])}" if "track" in table.columns else ""
        raise DataError(
            f"{table.place(row, 'time')}: {shown(float(times[row]))} s is before the "
            f"{shown(float(times[earlier]))} s of {table.line(earlier)}{of_track}: sort the rows by time"
        )


def _required(table: _Table, column: str, kind: str, model: Model) -> Array:
    taken = {*model.measurement_names, *model.control_names, "track", "time"}
    taken |= {f"truth_{state}" for state in model.state_names}
    if column not in table.columns:
        # A column that has a meaning of its own is not meant.
        meant = close(column, [each for each in table.columns if each not in taken])
        there = ", ".join(shown(each)[1:-1] for each in islice(table.columns, 16))
        hint = f"there are {there}" if meant is None else f"did you mean {meant!r}?"
        raise DataError(f"{table.name}: no column for the {kind} {column}: {hint}")
    return table.numbers(column)


def _truth_columns(table: _Table, model: Model) -> list[Array]:
    """One column per state, NaN where the table has none; no columns at all if it has no truth."""
    wanted = [f"truth_{state}" for state in model.state_names]
    missing = [column for column in wanted if column not in table.columns]
    for column in table.columns:
        if column.startswith("truth_") and column not in wanted:
            hint = nearest(column, missing or wanted)
            raise DataError(f"{table.name}: {shown(column)} is the truth of no state: {hint}")
    if not any(column in table.columns for column in wanted):
        return []
    unknown = np.full(table.rows, np.nan)
    return [table.numbers(column) if column in table.columns else unknown for column in wanted]


def _places(table: _Table) -> tuple[tuple[str, ...], NDArray[np.int64], NDArray[np.int64]]:
    """The tracks in the order of their first rows, and each row's track and step."""
    if "track" not in table.columns:
        return ("0",), np.zeros(table.rows, dtype=np.int64), np.arange(table.rows)
    indices: dict[str, int] = {}
    track = np.empty(table.rows, dtype=np.int64)
    step = np.empty(table.rows, dtype=np.int64)
    lengths: list[int] = []
    for row, cell in enumerate(table.columns["track"]):
        label = "" if cell is None else str(cell).strip()
        if not label:
            raise DataError(f"{table.place(row, 'track')}: empty: every row belongs to a track")
        index = indices.setdefault(label, len(indices))
        if index == len(lengths):
            lengths.append(0)
        track[row], step[row] = index, lengths[index]
        lengths[index] += 1
    return tuple(indices), track, step
