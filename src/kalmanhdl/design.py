"""A design: everything a user decides, as one frozen value."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from kalmanhdl.algorithm import ALGORITHMS, Algorithm, Conventional
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.errors import DataError
from kalmanhdl.graph.kinds import ITERATIVE, KINDS, limit
from kalmanhdl.model.model import Model
from kalmanhdl.model.multiple import MultipleModel
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.shape import Shape
from kalmanhdl.target import DERATED, Device
from kalmanhdl.target import device as known_device
from kalmanhdl.validation import (
    VERILOG_WORDS,
    InvalidValueError,
    as_real,
    as_tuple,
    identifier_problem,
    integer,
    nearest,
    shown,
)

if TYPE_CHECKING:
    from kalmanhdl.report.record import Record
    from kalmanhdl.simulate.side_by_side import Simulation

MAX_INTERVAL = 65536
MAX_CHANNELS = 65536
MAX_BLOCKS = 65536
MAX_CLOCKS = 999
MAX_CLOCK_MHZ = 10_000.0
MAX_SEEDS = 64
MAX_ROUNDS = 16
MAX_DERATE = 10.0
MAX_LANES = 256
MAX_STEPS = 1_000_000_000
MAX_SOLVER_SECONDS = 10_000.0
SOLVER_SECONDS = 2.0
"""Enough for most filters; seconds of the solver's own, some of a processor's each."""


class Coefficients(StrEnum):
    """Whether the model's numbers are part of the hardware, or kept in it so that they can be changed."""

    FIXED = "fixed"
    LOADABLE = "loadable"


class Streams(StrEnum):
    """How steps reach the lanes: by one stream that all share, or each by a stream of its own."""

    ONE = "one"
    LANE = "lane"


_LIMITS = MappingProxyType(
    {
        "interval": (1, MAX_INTERVAL),
        "channels": (1, MAX_CHANNELS),
        "multiplier_blocks": (0, MAX_BLOCKS),
        "latency": (1, MAX_INTERVAL),
        "lanes": (1, MAX_LANES),
    }
)
_OPTIONAL = ("interval", "multiplier_blocks", "latency")


@dataclass(frozen=True, slots=True, kw_only=True)
class Architecture:
    """How fast a step follows another, for how many tracks, and on how many operators.

    A step starts every ``interval`` clocks; None, or "bound", is the recurrence bound, the fastest one track
    allows, or with ``units`` the least that was found. ``updates_per_second`` says the same of the clock that
    is aimed at. ``channels`` tracks take turns. ``clock_mhz`` is the clock aimed at, ``multiplier_blocks``
    the most multiplications that may use DSP blocks; None leaves both to the tool. ``multiplier`` builds the
    others.

    ``units`` limits the operators of a kind, such as {"multiply": 4, "reciprocal": 1}; operations of a kind
    that is not named have an operator each. Without it, an interval of several clocks or a ``latency``, the
    most clocks from a step to its result, is met with as few operators as were found to suffice. ``clocks``
    are what operators of a kind in floating point take at least; the aim for the clock may ask for more.
    ``iterative`` kinds of ``units``, such as ("divide",), work for several clocks on one operation.
    ``solver_seconds`` of its own may a solver spend on better schedules than a list gives; 0: the list alone.

    ``lanes`` such filters stand side by side, each with ``channels`` tracks, ``units`` and
    ``multiplier_blocks`` of its own; ``streams`` lead to them.

    With ``coefficients`` "loadable" every number of the model, and what is derived from it, is kept in
    registers that a port writes, but for the model's zeros; fixed point, and linear models.
    """

    interval: int | None = None
    channels: int = 1
    clock_mhz: float | None = None
    multiplier_blocks: int | None = None
    multiplier: LogicProduct = LogicProduct.BOOTH
    units: Mapping[str, int] | None = None
    latency: int | None = None
    iterative: tuple[str, ...] = ()
    updates_per_second: float | None = None
    solver_seconds: float = SOLVER_SECONDS
    clocks: Mapping[str, int] | None = None
    lanes: int = 1
    streams: Streams = Streams.ONE
    coefficients: Coefficients = Coefficients.FIXED

    def __post_init__(self) -> None:
        if isinstance(self.interval, str) and self.interval == "bound":
            object.__setattr__(self, "interval", None)
        found: dict[str, object] = {
            "multiplier": _multiplier(self.multiplier),
            "streams": Streams(_word("streams", self.streams, tuple(Streams))),
            "coefficients": Coefficients(_word("coefficients", self.coefficients, tuple(Coefficients))),
            "clock_mhz": None if self.clock_mhz is None else _clock(self.clock_mhz),
            "units": None if self.units is None else _counts("units", self.units, MAX_BLOCKS),
            "clocks": None if self.clocks is None else _counts("clocks", self.clocks, MAX_CLOCKS),
            "solver_seconds": _number("solver_seconds", self.solver_seconds, MAX_SOLVER_SECONDS),
        }
        for key, (low, high) in _LIMITS.items():
            value = getattr(self, key)
            if value is not None or key not in _OPTIONAL:
                found[key] = integer("architecture", key, value, low, high)
        for key, each in found.items():
            object.__setattr__(self, key, each)
        object.__setattr__(self, "iterative", _iterative(self.iterative, self.units))
        if self.updates_per_second is not None:
            rate = _rate(self.updates_per_second, self.interval)
            object.__setattr__(self, "updates_per_second", rate)

    @property
    def shares_multipliers(self) -> bool:
        """Whether multiplications take turns on few multipliers."""
        if self.units is not None:
            return not {"multiply", "multiply_add"}.isdisjoint(self.units)
        return self.interval not in (None, 1) or bool(self.latency or self.updates_per_second)

    def lanes_fed(self, interval: int) -> int:
        """How many lanes, with a step every ``interval`` clocks, streams of a step a clock keep busy."""
        return self.lanes if self.streams is Streams.LANE else min(self.lanes, interval)


_PROCESSOR_WIDTH = 32
_PROCESSOR_LIMITS = MappingProxyType(
    {
        "size": (2, 16),
        "width": (8, 32),
        "fraction": (0, 32),
        "multipliers": (0, 16**3),
        "matrices": (2, 512),
        "program_words": (2, 512),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Processor:
    """The programmable matrix processor in place of hardware of the filter's own (``kind = "processor"``).

    Matrices of ``size`` by ``size``, by default as large as the filter needs; words of ``width`` bits, 32 by
    default, ``fraction`` of them behind the point, by default as many as the filter's numbers leave. Words of
    floating-point numbers are as long as the numerics say.
    ``multipliers`` for the products of matrices, a multiple of the size up to its cube: instructions overlap;
    0 is the paper's mode, eight clocks an instruction. ``matrices`` and ``program_words``, powers of two up
    to 512, are the sizes of the stores.
    """

    size: int | None = None
    width: int | None = None
    fraction: int | None = None
    multipliers: int | None = None
    matrices: int = 64
    program_words: int = 512

    def __post_init__(self) -> None:
        for key, (low, high) in _PROCESSOR_LIMITS.items():
            value = getattr(self, key)
            if value is not None or key in ("matrices", "program_words"):
                object.__setattr__(self, key, integer("architecture", key, value, low, high))
        if self.fraction is not None:
            integer("architecture", "fraction", self.fraction, 0, self.bits)
        for key in ("matrices", "program_words"):
            value = getattr(self, key)
            if value & (value - 1):
                raise InvalidValueError("architecture", key, f" = {value}: a power of two from 2 to 512")

    @property
    def bits(self) -> int:
        """Of a fixed-point word."""
        return _PROCESSOR_WIDTH if self.width is None else self.width


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """The device, its speed grade, and how many placements are tried.

    Where the clock that is asked for is not reached, the schedule is made anew up to ``rounds`` times, each
    time with what the placement before told. What it told is ``derate``: by kind of operator how many times
    the delay that the device's table says.

    Raises:
        DesignError: a device, a speed grade, a number of placements or of rounds, or a factor that cannot be.
    """

    device: str = "ecp5-25k"
    grade: int = 6
    seeds: int = 4
    rounds: int = 0
    derate: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "grade", known_device(self.device, self.grade).grade)
        object.__setattr__(self, "seeds", integer("target", "seeds", self.seeds, 1, MAX_SEEDS))
        object.__setattr__(self, "rounds", integer("target", "rounds", self.rounds, 0, MAX_ROUNDS))
        object.__setattr__(self, "derate", _derate(self.derate))

    @property
    def part(self) -> Device:
        """The device at its speed grade, with the delays that are derated."""
        return replace(known_device(self.device, self.grade), derate=self.derate)


# Names that ports of the hardware begin with.
_PORT = re.compile(r"(lane_\d+_)?(in|out)_")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """What is estimated, how, with which numbers, how fast and on which device.

    A word for ``algorithm`` is the algorithm of that kind with its defaults. With a ``processor`` the filter
    becomes a program of it, and ``architecture`` says nothing. With a ``shape`` (``control = "writable"``) it
    becomes an image of a programmable datapath, and ``architecture`` says nothing either.

    Raises:
        DesignError: a name, an algorithm or a number that cannot be.
    """

    name: str
    model: Model
    algorithm: Algorithm = field(default_factory=Conventional)
    numerics: FixedSpecification | FloatSpecification = field(default_factory=FixedSpecification)
    architecture: Architecture = field(default_factory=Architecture)
    target: Target = field(default_factory=Target)
    processor: Processor | None = None
    shape: Shape | None = None

    def __post_init__(self) -> None:
        problem = identifier_problem(self.name)
        if problem is None and self.name in VERILOG_WORDS:
            problem = f"{shown(self.name)} is a word of Verilog: choose another name"
        if problem is None and (self.name in ("clk", "rst") or _PORT.match(self.name)):
            problem = f"{shown(self.name)} is a name of the hardware's ports: choose another name"
        if problem:
            raise InvalidValueError("", "name", f": {problem}")
        for key, kinds in _PARTS.items():
            _check_part(key, getattr(self, key), kinds)
        if isinstance(self.model, type) or not all(hasattr(self.model, part) for part in _OF_MODELS):
            problem = f" = {shown(self.model)}: a model, as linear_model makes one of a motion's F, Q and H"
            raise InvalidValueError("", "model", problem)
        object.__setattr__(self, "algorithm", _algorithm(self.algorithm))
        # Says so where the algorithm does not suit the model.
        self.algorithm(self.model)
        if self.target.rounds and self.architecture.clock_mhz is None:
            problem = f" = {self.target.rounds}: say which clock they are to reach: architecture.clock_mhz"
            raise InvalidValueError("target", "rounds", problem)
        if self.shape is not None:
            self._check_programmable()
        if self.processor is not None and isinstance(self.numerics, FloatSpecification):
            _check_float_words(self.processor, self.numerics)
        if isinstance(self.numerics, FixedSpecification):
            _check_scales(self.numerics, self.model.n)
            _check_signals(self.numerics, self.model)

    def _check_programmable(self) -> None:
        if self.processor is not None:
            raise InvalidValueError("", "shape", ": the processor has none: leave one of the two out")
        if isinstance(self.numerics, FloatSpecification):
            problem = ' = "writable" is for fixed point: use [numerics] kind = "fixed"'
            raise InvalidValueError("architecture", "control", problem)

    @property
    def shares_multipliers(self) -> bool:
        """Whether multiplications take turns on few multipliers, those by constants among them."""
        return self.shape is not None or self.architecture.shares_multipliers

    @property
    def fixed_point(self) -> FixedSpecification:
        """The numerics of word lengths. Raises DesignError where they are floating point."""
        if isinstance(self.numerics, FloatSpecification):
            problem = ' = "float": word lengths and consistency are for fixed point only: use "fixed"'
            raise InvalidValueError("numerics", "kind", problem)
        return self.numerics

    @classmethod
    def load(cls, path: str | Path, constants: Mapping[str, float | str] | None = None) -> "Design":
        """The design of a TOML file.

        ``constants`` take the place of entries of [model.constants]: numbers, or expressions in strings.

        Raises:
            DesignError: the file cannot be read, or says something that cannot be; the message names
                file, line, table, key and value.
        """
        # Files need pydantic; a design made of objects does not.
        from kalmanhdl.design_file import load

        return load(path, constants)

    def simulate(
        self, z: ArrayLike, u: ArrayLike | None = None, time: ArrayLike | None = None
    ) -> "Simulation":
        """Filter measurements with the float reference and the bit-exact engine, side by side.

        z (steps, m) for one track or (steps, tracks, m), NaN or masked where missed; controls u likewise,
        behind them the run-time inputs. ``time`` (steps,) or (steps, tracks), in s, stands for the one that
        follows from it.

        Raises:
            DataError: a shape that does not suit the model, an infinite number, a control that is missing,
                controls of a model without any.
        """
        from kalmanhdl.pipeline import simulate
        from kalmanhdl.simulate.data import plots_from_arrays

        return simulate(self, plots_from_arrays(z, self.model, u, time))

    def build(
        self,
        out: str | Path,
        *,
        z: ArrayLike | None = None,
        u: ArrayLike | None = None,
        time: ArrayLike | None = None,
        verify_steps: int | None = None,
        place: bool = True,
        force: bool = False,
    ) -> "Record":
        """Take the design the whole line down and write the folder ``out``, report and all.

        With measurements z (and u and time, as for ``simulate``) they are filtered. ``verify_steps`` of the
        Verilog are held against the engine (0: none, None: what a minute at most takes); ``place``: also
        synthesis, place and route; ``force`` replaces an earlier build.

        Raises:
            DesignError: a number of steps that cannot be.
            OutputError, DataError, FormatError, ScheduleError, ToolError, VerificationError. Nothing is
                written then.
        """
        from kalmanhdl.build import build
        from kalmanhdl.simulate.data import plots_from_arrays

        if verify_steps is not None:
            verify_steps = integer("", "verify_steps", verify_steps, 0, MAX_STEPS)
        if z is None and (u is not None or time is not None):
            raise DataError("u and time are given without z: they belong to measurements")
        plots = None if z is None else plots_from_arrays(z, self.model, u, time)
        return build(self, out, plots=plots, verify_steps=verify_steps, place=place, force=force)


# What a motion has not, which is only a part of a model.
_OF_MODELS = ("kind", "state_names", "measurement_names")


def _check_float_words(processor: Processor, numerics: FloatSpecification) -> None:
    """Raises InvalidValueError for floating-point numbers that are no words of the processor."""
    low, high = _PROCESSOR_LIMITS["width"]
    width = numerics.form.width
    if not low <= width <= high:
        problem = f"its numbers have {width} bits, and the processor's words {low} to {high}"
        remedy = 'use format = "single" or "half", or other bits for exponent and mantissa'
        raise InvalidValueError("numerics", "kind", f' = "float": {problem}: {remedy}')
    if numerics.fused:
        problem = " = true: the processor rounds products before their sums: leave it out"
        raise InvalidValueError("numerics", "fused", problem)
    for key in ("width", "fraction"):
        value = getattr(processor, key)
        if value is not None:
            problem = f" = {value}: floating-point words are what [numerics] says: leave it out"
            raise InvalidValueError("architecture", key, problem)


_PARTS: dict[str, tuple[type, ...]] = {
    "numerics": (FixedSpecification, FloatSpecification),
    "architecture": (Architecture,),
    "target": (Target,),
    "processor": (Processor, type(None)),
    "shape": (Shape, type(None)),
}


def _check_part(key: str, value: object, kinds: tuple[type, ...]) -> None:
    if not isinstance(value, kinds):
        words = " or ".join(f"{kind.__name__}(...)" for kind in kinds)
        raise InvalidValueError("", key, f" = {shown(value)}: write {words}")


def _algorithm(choice: object) -> Algorithm:
    if isinstance(choice, Algorithm):
        return choice
    if not isinstance(choice, str) or choice not in ALGORITHMS:
        hint = nearest(str(choice), ALGORITHMS)
        raise InvalidValueError("algorithm", "kind", f" = {shown(choice)} is unknown: {hint}")
    return ALGORITHMS[choice]()


def _multiplier(word: object) -> LogicProduct:
    try:
        return LogicProduct(word)
    except ValueError:
        words = ", ".join(kind.value for kind in LogicProduct)
        raise InvalidValueError("architecture", "multiplier", f" = {shown(word)}: one of {words}") from None


def _counts(key: str, counts: object, most: int) -> dict[str, int]:
    if not isinstance(counts, Mapping):
        problem = f" = {shown(counts)}: write a count for each kind, such as {{ multiply = 4 }}"
        raise InvalidValueError("architecture", key, problem)
    for kind in counts:
        if not isinstance(kind, str) or kind not in KINDS:
            problem = f" is unknown: {nearest(str(kind), KINDS)}"
            raise InvalidValueError(f"architecture.{key}", str(kind), problem)
    return {kind: integer(f"architecture.{key}", kind, count, 1, most) for kind, count in counts.items()}


def _derate(factors: object) -> Mapping[str, float]:
    if not isinstance(factors, Mapping):
        problem = f" = {shown(factors)}: write a factor for each kind, such as {{ reciprocal = 1.5 }}"
        raise InvalidValueError("target", "derate", problem)
    found: dict[str, float] = {}
    for kind, factor in factors.items():
        if not isinstance(kind, str) or kind not in DERATED:
            problem = f" is unknown: {nearest(str(kind), DERATED)}"
            raise InvalidValueError("target.derate", str(kind), problem)
        number = as_real(factor)
        if number is None or not 1 <= number <= MAX_DERATE:
            problem = f" = {shown(factor)}: a number from 1 to {MAX_DERATE:g}"
            raise InvalidValueError("target.derate", kind, problem)
        found[kind] = number
    return found


def _iterative(given: object, units: Mapping[str, int] | None) -> tuple[str, ...]:
    kinds = as_tuple(given)
    if kinds is None:
        problem = f' = {shown(given)}: write a list of kinds, such as ["divide"]'
        raise InvalidValueError("architecture", "iterative", problem)
    for kind in kinds:
        if not isinstance(kind, str) or kind not in ITERATIVE:
            problem = f" = {shown(kind)}: {nearest(str(kind), ITERATIVE)}"
            raise InvalidValueError("architecture", "iterative", problem)
        if not units or limit(kind, units) is None:
            problem = f" = {shown(kind)}: how many there are is said by units: give it a count"
            raise InvalidValueError("architecture", "iterative", problem)
    return tuple(map(str, kinds))


def _word(key: str, word: object, words: tuple[str, ...]) -> str:
    if not isinstance(word, str) or word not in words:
        raise InvalidValueError("architecture", key, f" = {shown(word)}: {nearest(str(word), words)}")
    return word


def _clock(clock: object) -> float:
    found = as_real(clock)
    if found is None or not 0 < found <= MAX_CLOCK_MHZ:
        problem = f" = {shown(clock)}: a clock lies between 0 and {MAX_CLOCK_MHZ:.0f} MHz"
        raise InvalidValueError("architecture", "clock_mhz", problem)
    return found


def _number(key: str, value: object, high: float) -> float:
    found = as_real(value)
    if found is None or not 0 <= found <= high:
        raise InvalidValueError("architecture", key, f" = {shown(value)}: a number from 0 to {high:g}")
    return found


def _rate(rate: object, interval: int | None) -> float:
    found = as_real(rate)
    if found is None or not 0 < found <= MAX_CLOCK_MHZ * 1e6:
        problem = f" = {shown(rate)}: a rate lies between 0 and {MAX_CLOCK_MHZ * 1e6:.0g} a second"
        raise InvalidValueError("architecture", "updates_per_second", problem)
    if interval is not None:
        problem = f" = {shown(rate)}: the interval of {interval} says the rate already: give one of the two"
        raise InvalidValueError("architecture", "updates_per_second", problem)
    return found


def _check_scales(numerics: FixedSpecification, n: int) -> None:
    for key in ("scale", "covariance_scale"):
        scale = getattr(numerics, key)
        if isinstance(scale, tuple) and len(scale) != n:
            problem = f" has {len(scale)} numbers: one for each of the {n} states"
            raise InvalidValueError("numerics", key, problem)


def _check_signals(numerics: FixedSpecification, model: Model) -> None:
    """A format for an element that the model has not would be lost without a word."""
    n, m, p = model.n, model.m, model.p
    shapes = {"x": (n,), "z": (m,), "u": (p,), "y": (m,), "P": (n, n), "K": (n, m), "S": (m, m)}
    for name in numerics.signals:
        letter, _, inner = name.rstrip("]").partition("[")
        index, shape = tuple(map(int, inner.split(","))), shapes.get(letter)
        if shape is None:
            continue
        if isinstance(model, MultipleModel) and len(index) == len(shape) + 1:
            # That of a mode, which comes first.
            index = index[1:]
        if len(index) != len(shape) or any(i >= size for i, size in zip(index, shape, strict=True)):
            size = " x ".join(map(str, shape))
            problem = f" is no element of {letter}: {letter} is {size}, and indices begin at 0"
            raise InvalidValueError("numerics.signals", name, problem)
        if letter in "PS" and index[0] > index[1]:
            mirrored = f"{letter}[{index[1]},{index[0]}]"
            problem = f" is below the diagonal: write {mirrored}, which is the same number"
            raise InvalidValueError("numerics.signals", name, problem)
