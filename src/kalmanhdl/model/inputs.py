"""Run-time inputs: numbers that come with every step and stand in a model's formulas, such as dt.

They are the last of a model's controls u, and have limits that whoever drives the filter keeps.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model import checks
from kalmanhdl.model.expression import RESERVED
from kalmanhdl.model.formulas import Formulas, formulas
from kalmanhdl.validation import InvalidModelValueError, as_flag, shown

Array = NDArray[np.float64]

MAX_INPUTS = 8
# Where a matrix of formulas is tried: the corners of the inputs' limits, and points between them.
_POINTS, _SEED = 32, 1960


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTimeInput:
    """A number from ``low`` to ``high``; ``from_time``: the time since the row before of its track."""

    name: str
    low: float
    high: float
    from_time: bool = False

    def divided(self, unit: float) -> "RunTimeInput":
        """The same input in another unit."""
        return replace(self, low=self.low / unit, high=self.high / unit)


Entries = Sequence[Sequence[float | str]]
"""A matrix whose entries are numbers, or formulas in inputs and constants."""


def checked_inputs(
    inputs: Sequence[RunTimeInput], taken: Sequence[str], constants: Mapping[str, float]
) -> tuple[RunTimeInput, ...]:
    """Inputs whose names and limits can be. Raises ModelError."""
    inputs = checks.listed("inputs", inputs, "run-time inputs")
    for each in inputs:
        if not isinstance(each, RunTimeInput) or as_flag(each.from_time) is None:
            raise checks.fault("inputs", f": {shown(each)} is none: give RunTimeInput(name=, low=, high=)")
    if len(inputs) > MAX_INPUTS:
        raise checks.fault("inputs", f" are {len(inputs)}: at most {MAX_INPUTS}")
    names = checks.names("inputs", [each.name for each in inputs], len(inputs), "u")
    for each in inputs:
        key = f"inputs.{each.name}"
        if each.name in RESERVED or each.name in constants or each.name in taken:
            raise checks.fault(key, " has another meaning in this model: choose another name")
        low, high = checks.array(key, [each.low, each.high], (2,), "range = [lowest, highest]")
        if not low < high:
            problem = f" = [{shown(each.low)}, {shown(each.high)}]: the first must be less"
            raise checks.fault(key, problem)
    timed = [each.name for each in inputs if each.from_time]
    if len(timed) > 1:
        raise checks.fault(f"inputs.{timed[1]}", f': {timed[0]} is from = "time" already: one input is')
    checks.check_columns([*taken, *names], [])
    return tuple(replace(each, low=float(each.low), high=float(each.high)) for each in inputs)


def points(inputs: Sequence[RunTimeInput], p: int) -> Array:
    """Values of u (k, p) that try inputs out: corners of their limits, points between; controls are 0."""
    limits = np.array([[each.low, each.high] for each in inputs])
    corners = np.array(list(product(*limits)))
    between = np.random.default_rng(_SEED).random((_POINTS, len(inputs)))
    between = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * between
    u = np.zeros((len(corners) + _POINTS, p))
    u[:, p - len(inputs) :] = np.concatenate([corners, between])
    return u


def middle(inputs: Sequence[RunTimeInput], p: int) -> Array:
    """The value of u (p,) in the middle of the inputs' limits; controls are 0."""
    u = np.zeros(p)
    u[p - len(inputs) :] = [(each.low + each.high) / 2 for each in inputs]
    return u


def matrix_formulas(
    key: str,
    given: Entries,
    shape: tuple[int, int],
    controls: Sequence[str],
    inputs: Sequence[RunTimeInput],
    constants: Mapping[str, float],
) -> Formulas:
    """A matrix whose entries are numbers or formulas in inputs and constants, over u. Raises ModelError."""
    rows = checks.rows(key, given)
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        raise checks.fault(key, f" is not {shape[0]} x {shape[1]}: give as many rows and columns")
    names = {"u": (*controls, *(each.name for each in inputs))}
    entries = [entry for row in rows for entry in row]
    try:
        found = formulas(key, entries, len(entries), names, constants)
    except InvalidModelValueError as error:
        raise checks.fault(key, _in_rows(error.problem, shape[1])) from None
    used = found.dependence("u", len(names["u"]))
    for k, name in enumerate(controls):
        if used[:, k].any():
            raise checks.fault(key, f": {name} is a control, and has no limits: make it one of inputs")
    return replace(found, shape=shape)


def _in_rows(problem: str, columns: int) -> str:
    """A problem of entry [k] as one of the entry in its row and column."""
    match = re.match(r"\[(\d+)\]", problem)
    if match is None:
        return problem
    row, column = divmod(int(match[1]), columns)
    return f"[{row},{column}]{problem[match.end() :]}"


def covariance_formulas(
    key: str,
    given: Entries,
    size: int,
    controls: Sequence[str],
    inputs: Sequence[RunTimeInput],
    constants: Mapping[str, float],
    *,
    definite: bool,
) -> Formulas:
    """A covariance (size, size) of formulas, tried at ``points``. Raises ModelError where it is none."""
    found = matrix_formulas(key, given, (size, size), controls, inputs, constants)
    p = len(controls) + len(inputs)
    for u, value in values(key, found, points(inputs, p)):
        try:
            checks.covariance(key, value, definite=definite)
        except InvalidModelValueError as error:
            raise checks.fault(key, f" where {_place(inputs, u)}: {key}{error.problem}") from None
    return found


def values(key: str, found: Formulas, us: Array) -> Iterator[tuple[Array, Array]]:
    """The value of a matrix of formulas at each of us (k, p). Raises ModelError where it has none."""
    for u in us:
        with np.errstate(all="ignore"):
            try:
                value = found(u=u.astype(object)).astype(np.float64)
            except (ArithmeticError, ValueError):
                value = np.full(found.shape, np.nan)
        if not np.isfinite(value).all():
            raise checks.fault(key, f" is no finite number for u = {u.tolist()}: narrow the inputs' range")
        yield u, value


def _place(inputs: Sequence[RunTimeInput], u: Array) -> str:
    last = u[len(u) - len(inputs) :]
    return ", ".join(f"{each.name} = {value:.6g}" for each, value in zip(inputs, last, strict=True))


def outside(inputs: Sequence[RunTimeInput], u: Array) -> tuple[tuple[int, ...], RunTimeInput] | None:
    """The first place of u (..., p) that holds an input outside of its limits, and the input."""
    for k, each in enumerate(inputs):
        column = u[..., u.shape[-1] - len(inputs) + k]
        wrong = np.argwhere((column < each.low) | (column > each.high))
        if len(wrong):
            return tuple(map(int, wrong[0])), each
    return None


def drawn(inputs: Sequence[RunTimeInput], random: np.random.Generator, steps: int, tracks: int) -> Array:
    """Values (steps, tracks, inputs): a third of the tracks stay at a corner of the limits, a third jump
    between corners, the others are anywhere."""
    low, high = np.array([[each.low, each.high] for each in inputs]).T
    share = random.random((steps, tracks, len(inputs)))
    kind = np.arange(tracks) % 3
    share[:, kind == 0] = np.rint(share[:1, kind == 0])
    share[:, kind == 1] = np.rint(share[:, kind == 1])
    # An end of the limits, exactly.
    return np.asarray(np.where(share == 1.0, high, low + (high - low) * share))
