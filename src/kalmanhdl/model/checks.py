"""The checks a model passes once, when it is made."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.validation import (
    InvalidModelValueError,
    as_real,
    as_tuple,
    identifier_problem,
    names_problem,
    shown,
)

Array = NDArray[np.float64]

MAX_STATES = 64
MAX_MEASUREMENTS = 64

# A user types a matrix in decimals: the two halves of a symmetric one may differ in the last digits.
SYMMETRY_TOLERANCE = 1e-9
# Least eigenvalue of the correlation form: rounded semidefinite matrices come out slightly negative.
SEMIDEFINITE_TOLERANCE = 1e-9
DEFINITE_TOLERANCE = 1e-13
OBSERVABILITY_TOLERANCE = 1e-11

# Elements of an array of objects that convert to a float and are none.
_NO_REALS = (str, bytes, bool, np.bool_, np.datetime64, np.timedelta64)

# Columns of data files and of results that are not measurements.
_RESERVED = ("track", "time", "step", "nis")


def fault(key: str, problem: str) -> InvalidModelValueError:
    """The error for a key of the model."""
    table, _, last = f"model.{key}".rpartition(".")
    return InvalidModelValueError(table, last, problem)


def array(key: str, value: ArrayLike, shape: tuple[int | None, ...], rule: str) -> Array:
    """A finite, read-only array of float64 of a shape in which None is any size >= 1."""
    try:
        result = reals(value)
    except (TypeError, ValueError, OverflowError):
        raise fault(key, f" = {shown(value)} is no array of real numbers: {rule}") from None
    expected = zip(result.shape, shape, strict=False)
    if result.ndim != len(shape) or any(b == 0 if s is None else b != s for b, s in expected):
        size = " x ".join(map(str, result.shape)) or "a single number"
        raise fault(key, f" is {size}: {rule}")
    finite = np.isfinite(result)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise fault(key, f"{place(index)} = {result[index]} is not finite: {rule}")
    result.flags.writeable = False
    return result


def reals(value: ArrayLike) -> Array:
    """A new array of float64 from real numbers, NaN where it is masked or has None.

    Raises:
        TypeError, ValueError, OverflowError: something else, such as texts, dates, truths or ragged lists.
    """
    if isinstance(value, list | tuple) and any(isinstance(each, np.ma.MaskedArray) for each in value):
        value = np.ma.array(value)
    raw = value if isinstance(value, np.ndarray) else np.asarray(value)
    if raw.dtype.kind not in "iufO":
        raise TypeError
    if raw.dtype.kind == "O" and any(isinstance(each, _NO_REALS) for each in raw.flat):
        raise TypeError
    result = np.array(raw, dtype=np.float64)
    if isinstance(raw, np.ma.MaskedArray):
        result[np.ma.getmaskarray(raw)] = np.nan
    return result


def place(index: Sequence[int]) -> str:
    """``[1,0]``."""
    return f"[{','.join(map(str, index))}]"


def symmetric(key: str, matrix: Array) -> Array:
    """The matrix, exactly symmetric.

    Raises:
        ModelError: its halves differ by more than SYMMETRY_TOLERANCE of the pair, measured against the
            variances it links as well.
    """
    deviation = np.abs(matrix - matrix.T)
    root = np.sqrt(np.abs(np.diag(matrix)))
    size = np.maximum(np.maximum(np.abs(matrix), np.abs(matrix.T)), np.outer(root, root))
    wrong = np.argwhere(deviation > SYMMETRY_TOLERANCE * size)
    if len(wrong):
        i, j = (int(k) for k in wrong[0])
        raise fault(
            key,
            f" is not symmetric: {key_name(key)}[{i},{j}] = {shown(float(matrix[i, j]))} but "
            f"{key_name(key)}[{j},{i}] = {shown(float(matrix[j, i]))}: write the same number in both",
        )
    result = matrix / 2 + matrix.T / 2
    result.flags.writeable = False
    return result


def key_name(key: str) -> str:
    """The last part of a dotted key."""
    return key.rpartition(".")[2]


def covariance(key: str, matrix: Array, *, definite: bool) -> Array:
    """The symmetrised matrix, if it can be a covariance (positive definite where asked)."""
    result = symmetric(key, matrix)
    variances = np.diag(result)
    bad = np.argwhere(variances <= 0 if definite else variances < 0)
    if len(bad):
        i = int(bad[0][0])
        rule = "a variance is greater than 0" if definite else "a variance is 0 or greater"
        raise fault(key, f"[{i},{i}] = {shown(float(variances[i]))}: {rule}")
    root = np.sqrt(np.where(variances > 0, variances, 1.0))
    correlation = result / root[:, None] / root[None, :]
    with_zero = (variances == 0)[:, None] & (result != 0)
    if with_zero.any():
        i, j = (int(k) for k in np.argwhere(with_zero)[0])
        problem = f"[{i},{j}] = {shown(float(result[i, j]))} but {key_name(key)}[{i},{i}] = 0: "
        raise fault(key, problem + "a variance of 0 has no covariances")
    large = np.argwhere(np.abs(np.triu(correlation, 1)) > 1 + SEMIDEFINITE_TOLERANCE)
    if len(large):
        i, j = (int(k) for k in large[0])
        problem = f" is indefinite: {key_name(key)}[{i},{j}] = {shown(float(result[i, j]))} exceeds "
        limit = shown(float(root[i] * root[j]))
        raise fault(key, f"{problem}the root of its two variances' product, {limit}: make it smaller")
    least = float(np.linalg.eigvalsh(correlation)[0])
    if least < -SEMIDEFINITE_TOLERANCE or (definite and least <= DEFINITE_TOLERANCE):
        kind = "definite" if definite else "semidefinite"
        problem = f" is not positive {kind}: its correlation form has the eigenvalue {shown(least)}"
        raise fault(key, f"{problem}: lower its off-diagonal numbers or raise its diagonal")
    return result


def listed(key: str, value: object, what: str = "names") -> tuple[Any, ...]:
    """The elements of a list. Raises ModelError where it is none."""
    found = as_tuple(value)
    if found is None:
        raise fault(key, f" = {shown(value)}: give a list of {what}")
    return found


def rows(key: str, value: object) -> list[tuple[Any, ...]]:
    """The rows of a matrix, of whatever entries. Raises ModelError where it is none."""
    found = [as_tuple(row) for row in as_tuple(value) or ()]
    if not found or None in found:
        raise fault(key, f" = {shown(value)} is no matrix: give a list of rows, each a list")
    return [row for row in found if row is not None]


def constants(value: object) -> dict[str, float]:
    """Numbers by name. Raises ModelError where something is none."""
    if not isinstance(value, Mapping | None):
        raise fault("constants", f' = {shown(value)}: give numbers by name, such as {{"T": 1.5}}')
    found = {}
    for name, entry in (value or {}).items():
        number = as_real(entry)
        problem = identifier_problem(name)
        if problem is not None or number is None or not math.isfinite(number):
            raise fault("constants", f": {problem or f'{name} = {shown(entry)} is no finite number'}")
        found[name] = number
    return found


def names(key: str, value: Sequence[str] | None, count: int, letter: str) -> tuple[str, ...]:
    """``count`` distinct names; None gives ``x0, x1, ...``."""
    if value is None:
        return tuple(f"{letter}{i}" for i in range(count))
    given = listed(key, value)
    if len(given) != count:
        raise fault(key, f" is {len(given)} names: give a list of {count}")
    problem = names_problem(given)
    if problem:
        raise fault(key, f": {problem}")
    return tuple(map(str, given))


def check_columns(measurements: Sequence[str], controls: Sequence[str]) -> None:
    """Measurements and controls are columns of one table: no name may have two meanings there."""
    for key, group in (("measurement", measurements), ("control", controls)):
        for name in group:
            if name in _RESERVED or name.startswith("truth_"):
                problem = f": {name!r} is a column of its own in data files: choose another name"
                raise fault(key, problem)
    both = sorted(set(measurements) & set(controls))
    if both:
        raise fault("control", f": {both[0]!r} is a measurement too: give every one its own name")


def units(value: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """One unit a state; None leaves them empty."""
    if value is None:
        return ("",) * count
    given = as_tuple(value)
    if given is None or len(given) != count:
        raise fault("unit", f" = {shown(value)}: give a list of {count}, one a state")
    for unit in given:
        if not isinstance(unit, str) or len(unit) > 16 or not unit.isprintable():
            raise fault("unit", f': {shown(unit)} is no unit: a short printable string such as "m/s"')
    return tuple(map(str, given))


def ranges(value: ArrayLike | None, count: int) -> Array | None:
    """Declared limits of the measurements, (m, 2)."""
    if value is None:
        return None
    rule = f"one [low, high] for each of {count} measurements"
    result = array("measurement_range", value, (count, 2), rule)
    for j, (low, high) in enumerate(result):
        if not low < high:
            problem = f"[{j}] = [{shown(float(low))}, {shown(float(high))}]: the first must be less"
            raise fault("measurement_range", problem)
    return result


def unobservable(F: Array, H: Array) -> tuple[int, ...]:
    """The states that no sequence of measurements determines.

    Grows an orthonormal basis of the row space of (H, HF, HF^2, ...); a state outside of it takes part
    in the unobservable subspace.
    """
    n = F.shape[0]
    basis = np.zeros((0, n))
    fresh = [row for row in H if row.any()]
    while fresh and len(basis) < n:
        row = fresh.pop(0)
        row = row / np.abs(row).max()
        row = row / np.linalg.norm(row)
        for _ in range(2):  # the second pass removes what rounding left behind
            row = row - basis.T @ (basis @ row)
        size = float(np.linalg.norm(row))
        if size > OBSERVABILITY_TOLERANCE:
            basis = np.vstack([basis, row / size])
            following = basis[-1] @ F
            if following.any() and np.isfinite(following).all():
                fresh.append(following)
    outside = 1.0 - (basis**2).sum(axis=0)
    return tuple(int(i) for i in np.flatnonzero(outside > 1e-6))
