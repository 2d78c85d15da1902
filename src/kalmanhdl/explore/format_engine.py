"""Runs a program under any formats, without compiling it anew: thousands of choices of formats a minute.

Values are doubles, so that the results are those of the hardware as long as every exact sum and product
fits 53 bits: for words of up to about 26 bits. Beyond that a last bit is wrong now and then; whatever rests
on this engine is confirmed with the bit-exact one at the end.
"""

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.division import DivisionMethod, TableNewton, reciprocal_table
from kalmanhdl.arithmetic.fixed import Overflow, Rounding
from kalmanhdl.errors import ToolError
from kalmanhdl.explore.program import Code, Program
from kalmanhdl.numerics.quantise import significant
from kalmanhdl.numerics.signed_digits import canonical_signed_digits
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.simulate.compiler import find_compiler, shared_library

Array = NDArray[np.float64]

_ROUNDINGS = (Rounding.FLOOR, Rounding.HALF_UP, Rounding.HALF_EVEN, Rounding.TOWARD_ZERO)
_OVERFLOWS = (Overflow.SATURATE, Overflow.WRAP)

_CODE = np.dtype([(name, np.int32) for name in ("code", "a", "b", "c", "slot", "matters")])
_FORMAT = np.dtype([(name, np.int32) for name in ("width", "fraction", "signed", "whole")])
_CONSTANT = np.dtype([(name, np.float64) for name in ("value", "positive", "negative", "least")])
_TYPE = np.dtype(
    [("low", np.float64), ("high", np.float64), ("fraction", np.int32), ("width", np.int32)]
    + [(name, np.int32) for name in ("at", "leaves", "live", "padding")]
    + [(name, np.float64) for name in ("value", "least", "scale", "unit")]
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """What a program is run on: real inputs in the hardware's units, by number, flags, and commands.

    Shapes: inputs (k, steps, tracks), flags (k, steps, tracks), commands (steps, tracks): 0 no step, 1 a
    step, 2 one in which clamped values count.
    """

    inputs: Array
    flags: NDArray[np.uint8]
    commands: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """What a program put out: (outputs, steps, tracks), in the hardware's units; no number where no step is.

    ``types`` holds for each step of the program the type that it took, ``clamped`` how often its value did
    not fit its format where it mattered: in the first such step of a track, for what follows means nothing.
    ``beyond`` counts those for want of bits above the binary point.
    """

    outputs: Array
    types: NDArray[np.void]
    clamped: Array
    beyond: Array


class _Program(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int32) for name in ("count", "states", "outputs", "inputs", "flags", "tables")),
        *((name, ctypes.c_int32) for name in ("rounding", "overflow", "index_bits", "iterations")),
        *((name, ctypes.c_void_p) for name in ("code", "constants", "state_leaves", "state_roots")),
        *((name, ctypes.c_void_p) for name in ("output_roots", "row_begin", "rows", "reciprocals")),
    )


@dataclass(frozen=True, slots=True, eq=False)
class FormatEngine:
    """A program with the arithmetic that all choices of formats share: rounding, overflow, division.

    ``outputs`` are the outputs and new states that a run keeps. Runs may be made in several threads at once.
    """

    program: Program
    outputs: tuple[str, ...]
    rounding: Rounding
    overflow: Overflow
    division: DivisionMethod

    @staticmethod
    def of(
        program: Program, specification: FixedSpecification, outputs: Sequence[str] | None = None
    ) -> "FormatEngine":
        """The engine of a program. Raises ToolError where there is no C compiler."""
        _function()
        names = tuple(name for name, _ in program.outputs) if outputs is None else tuple(outputs)
        division = specification.division
        return FormatEngine(program, names, specification.rounding, specification.overflow, division)

    def forms(self, specification: FixedSpecification) -> NDArray[np.void]:
        """The formats of a specification, a row for each slot of the program."""
        chosen = (slot.chosen(specification) for slot in self.program.slots)
        rows = [(form.width, form.fraction, form.signed, whole) for form, whole in chosen]
        return np.array(rows, _FORMAT)

    def run(self, forms: NDArray[np.void], constant_width: int, drive: Drive) -> Run:
        """All steps of all tracks under formats. Raises MemoryError."""
        program, (steps, tracks) = self.program, drive.commands.shape
        static = _static(program)
        constants = _constants(program, constant_width)
        roots = {**{name: root for name, _, root in program.states}, **dict(program.outputs)}
        kept = np.array([roots[name] for name in self.outputs], np.int32)
        division = self.division
        by_table = isinstance(division, TableNewton)
        reciprocals = _reciprocals(division.index_bits) if isinstance(division, TableNewton) else kept
        handed = _Program(
            count=len(program.steps),
            states=len(program.states),
            outputs=len(kept),
            inputs=len(program.inputs),
            flags=len(program.flags),
            tables=len(program.tables),
            rounding=_ROUNDINGS.index(self.rounding),
            overflow=_OVERFLOWS.index(self.overflow),
            index_bits=division.index_bits if isinstance(division, TableNewton) else 0,
            iterations=division.iterations if isinstance(division, TableNewton) else 0,
            code=static.code.ctypes.data,
            constants=constants.ctypes.data,
            state_leaves=static.state_leaves.ctypes.data,
            state_roots=static.state_roots.ctypes.data,
            output_roots=kept.ctypes.data,
            row_begin=static.row_begin.ctypes.data,
            rows=static.rows.ctypes.data,
            reciprocals=reciprocals.ctypes.data if by_table else None,
        )
        outputs = np.zeros((len(kept), steps, tracks))
        types = np.empty(len(program.steps), _TYPE)
        clamped = np.zeros((len(program.steps), 2))
        failed = _function()(
            ctypes.byref(handed),
            _address(forms),
            ctypes.c_int64(steps),
            ctypes.c_int64(tracks),
            ctypes.c_int32(program.flags.index("initialise")),
            *(_address(a) for a in (drive.inputs, drive.flags, drive.commands, outputs, types, clamped)),
        )
        if failed:
            raise MemoryError
        return Run(outputs=outputs, types=types, clamped=clamped[:, 0], beyond=clamped[:, 1])


def known_clamped(run: Run, program: Program) -> bool:
    """Whether a constant, as a start has them, did not fit its format."""
    suspects = np.flatnonzero((run.types["leaves"] != 0) & (run.types["live"] != 0))
    return any(
        program.steps[k].code is Code.QUANTISE
        and program.steps[program.steps[k].a].code in (Code.CONSTANT, Code.ROUNDED, Code.BESIDE)
        for k in suspects.tolist()
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Static:
    """The arrays of a program that no format changes."""

    code: NDArray[np.void]
    state_leaves: NDArray[np.int32]
    state_roots: NDArray[np.int32]
    row_begin: NDArray[np.int32]
    rows: Array


@lru_cache(maxsize=16)
def _static(program: Program) -> _Static:
    rows = [(s.code, s.a, s.b, s.c, s.slot, m) for s, m in zip(program.steps, program.matters, strict=True)]
    lengths = [len(table) for table in program.tables]
    return _Static(
        code=np.array(rows, _CODE),
        state_leaves=np.array([leaf for _, leaf, _ in program.states], np.int32),
        state_roots=np.array([root for _, _, root in program.states], np.int32),
        row_begin=np.cumsum([0, *lengths], dtype=np.int32),
        rows=np.array([float(row) for table in program.tables for row in table]),
    )


@lru_cache(maxsize=256)
def _constants(program: Program, width: int) -> NDArray[np.void]:
    """The constants of a program as so many significant bits leave them."""
    result = np.zeros(len(program.steps), _CONSTANT)
    for index, step in enumerate(program.steps):
        if step.code in (Code.ROUNDED, Code.SCALE):
            value = significant(step.value, width)
            positive, negative = _digit_sums(value)
            result[index] = (float(value), positive, negative, 0.0)
        elif step.code is Code.CONSTANT:
            result[index]["value"] = float(step.value)
        elif step.code is Code.RECIPROCAL:
            result[index]["least"] = float(step.value)
    return result


def _digit_sums(value: Fraction) -> tuple[float, float]:
    """The sums of the positive and of the negative signed digits of a constant."""
    digits = canonical_signed_digits(abs(value.numerator))
    positive, negative = (
        float(Fraction(sum(1 << place for sign, place in digits if sign == wanted), value.denominator))
        for wanted in (1, -1)
    )
    return (positive, negative) if value >= 0 else (negative, positive)


@lru_cache(maxsize=8)
def _reciprocals(index_bits: int) -> NDArray[np.int32]:
    return np.array(reciprocal_table(index_bits), np.int32)


def _address(array: NDArray[Any]) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


@lru_cache(maxsize=1)
def _function() -> Callable[..., int]:
    command = find_compiler()
    if command is None:
        raise ToolError("no C compiler: choosing formats needs one: install gcc or clang, or set CC")
    source = (files("kalmanhdl.explore") / "format_engine.c").read_text(encoding="utf-8")
    found: Callable[..., int] = ctypes.CDLL(str(shared_library(source, command))).run_formats
    return found
