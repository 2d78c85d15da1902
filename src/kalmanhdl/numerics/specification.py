"""What a design asks of its number formats. The formats themselves are chosen from it later."""

import math
import re
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, TypeVar

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.numerics.functions.method import Cordic, FunctionMethod, Interpolation
from kalmanhdl.validation import InvalidValueError, nearest, shown

MAX_WIDTH = 1024
MAX_FRACTION = 4096
MAX_INDEX_BITS = 16
MAX_FUNCTION_INDEX_BITS = 12
MAX_ITERATIONS = 8
MAX_COAST = 32
MAX_HEADROOM = 64
DEFAULT_WIDTH = 16

SIGNAL_CLASSES = (
    "state",
    "covariance",
    "gain",
    "measurement",
    "control",
    "innovation",
    "innovation_covariance",
    "reciprocal",
    "nis",
    "constant",
    "product",
)
# The widths that ``width`` does not touch: 18 bits are a DSP block's operand, and the NIS is a mere monitor.
_OWN_WIDTH = MappingProxyType({"nis": 16, "constant": 18})

SIGNAL = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,31}\[\d{1,4}(,\d{1,4}){0,2}\]\Z")
_Q_FORMAT = re.compile(r"(U?)Q(-?\d{1,5})\.(-?\d{1,5})\Z")

Form = int | Fixed
"""A width, whose binary point the range analysis places, or a whole format."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedSpecification:
    """Fixed-point arithmetic as the user asks for it.

    ``classes`` gives a format per signal class, ``signals`` per signal (``"P[0,1]"``), which goes first;
    ``width`` serves the classes not given. ``scale`` holds the real value of one unit of each state
    ("auto": powers of two chosen by the tool). ``covariance_scale`` divides the covariance of each
    decoupled component: the general form of the normalisation by sigma**2 of lee1997, eq. 14; one number
    for all, or one per state, equal within a component.

    ``headroom`` gives signals or classes bits above the binary point beyond what the range analysis places:
    for values that only rare tracks or the user's own data reach. A width stays what it is.

    ``functions`` is how sines and the like are computed; None chooses by the width of each result.

    The formats hold what runs of up to ``coast`` missed measurements do to the covariance.

    Raises:
        DesignError: a class, a signal, a format, a scale or a method that cannot be.
    """

    width: int = DEFAULT_WIDTH
    classes: dict[str, Form] = field(default_factory=dict)
    signals: dict[str, Form] = field(default_factory=dict)
    rounding: Rounding = Rounding.FLOOR
    overflow: Overflow = Overflow.SATURATE
    scale: Literal["auto"] | tuple[float, ...] = "auto"
    covariance_scale: Literal["auto"] | float | tuple[float, ...] = "auto"
    division: DivisionMethod = field(default_factory=LongDivision)
    functions: FunctionMethod | None = None
    coast: int = 5
    headroom: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_form("width", self.width)
        object.__setattr__(self, "rounding", _mode("rounding", self.rounding, Rounding))
        object.__setattr__(self, "overflow", _mode("overflow", self.overflow, Overflow))
        for name, form in self.classes.items():
            if name not in SIGNAL_CLASSES:
                problem = f" is no signal class: {nearest(str(name), SIGNAL_CLASSES)}"
                raise InvalidValueError("numerics", str(name), problem)
            _check_form(name, form)
        for name, form in self.signals.items():
            if not SIGNAL.match(name):
                problem = f'{shown(name)} is no signal: write it like "x[0]" or "P[0,1]"'
                raise InvalidValueError("numerics.signals", "", problem)
            _check_form(name, form, "numerics.signals")
        _check_headroom(self.headroom)
        _check_scale("scale", self.scale)
        _check_scale("covariance_scale", self.covariance_scale)
        _check_division(self.division)
        _check_functions(self.functions)
        if (
            isinstance(self.coast, bool)
            or not isinstance(self.coast, int)
            or not 0 <= self.coast <= MAX_COAST
        ):
            raise InvalidValueError(
                "numerics", "coast", f" = {shown(self.coast)}: an integer from 0 to {MAX_COAST}"
            )

    def form(self, signal_class: str, signal: str | None = None) -> Form:
        """The format asked for: the signal's own, else its class's, else the default width."""
        if signal is not None and signal in self.signals:
            return self.signals[signal]
        return self.classes.get(signal_class, _OWN_WIDTH.get(signal_class, self.width))

    def key(self, signal_class: str, signal: str | None = None) -> str:
        """The key of a design that says, or would say, what ``form`` gives."""
        if signal is not None and signal in self.signals:
            return f"[numerics.signals] {signal}"
        own = signal_class in self.classes or signal_class in _OWN_WIDTH
        return f"[numerics] {signal_class if own else 'width'}"

    def room(self, signal_class: str, signal: str | None = None) -> int:
        """Bits above the binary point beyond those of the range analysis: the signal's, else its class's."""
        if signal is not None and signal in self.headroom:
            return self.headroom[signal]
        return self.headroom.get(signal_class, 0)


def parse_format(text: str) -> Fixed | None:
    """``"Q12.20"``: 12 integer bits, sign included, and 20 fraction bits; ``"UQ12.20"`` is unsigned."""
    match = _Q_FORMAT.match(text)
    if match is None:
        return None
    integer, fraction = int(match[2]), int(match[3])
    if not 1 <= integer + fraction <= MAX_WIDTH:
        return None
    return Fixed(width=integer + fraction, fraction=fraction, signed=not match[1])


_Mode = TypeVar("_Mode", Rounding, Overflow)


def _mode(key: str, value: object, modes: type[_Mode]) -> _Mode:
    """A mode, or the word for it as a design file has it."""
    try:
        return modes(value)
    except ValueError:
        words = ", ".join(mode.value for mode in modes)
        raise InvalidValueError("numerics", key, f" = {shown(value)}: one of {words}") from None


def _check_form(key: str, form: object, table: str = "numerics") -> None:
    width = form.width if isinstance(form, Fixed) else form
    if isinstance(width, bool) or not isinstance(width, int) or not 1 <= width <= MAX_WIDTH:
        raise InvalidValueError(table, key, f" = {shown(form)}: a width is an integer from 1 to {MAX_WIDTH}")
    if isinstance(form, Fixed) and abs(form.fraction) > MAX_FRACTION:
        problem = f" = {form}: a fraction is an integer from -{MAX_FRACTION} to {MAX_FRACTION}"
        raise InvalidValueError(table, key, problem)


def _check_headroom(headroom: dict[str, int]) -> None:
    for name, bits in headroom.items():
        if name not in SIGNAL_CLASSES and not SIGNAL.match(name):
            problem = f'{shown(name)} is neither a signal, such as "P[0,1]", nor a class of signals'
            raise InvalidValueError("numerics.headroom", "", problem)
        if isinstance(bits, bool) or not isinstance(bits, int) or not 0 <= bits <= MAX_HEADROOM:
            problem = f" = {shown(bits)}: an integer from 0 to {MAX_HEADROOM}"
            raise InvalidValueError("numerics.headroom", name, problem)


def _check_scale(key: str, scale: object) -> None:
    if scale == "auto":
        return
    for number in scale if isinstance(scale, tuple) else (scale,):
        if not isinstance(number, int | float) or not (math.isfinite(number) and number > 0):
            problem = f' = {shown(number)}: a scale is a positive number, or "auto"'
            raise InvalidValueError("numerics", key, problem)


def _check_division(division: DivisionMethod) -> None:
    if isinstance(division, LongDivision):
        if division.radix not in (2, 4):
            raise InvalidValueError("numerics", "division", f" radix {shown(division.radix)}: radix 2 or 4")
        return
    if not isinstance(division, TableNewton):
        problem = f' = {shown(division)}: "radix2", "radix4" or {{ table = 10, newton = 0 }}'
        raise InvalidValueError("numerics", "division", problem)
    if not 1 <= division.index_bits <= MAX_INDEX_BITS:
        problem = f" table = {shown(division.index_bits)}: an index has 1 to {MAX_INDEX_BITS} bits"
        raise InvalidValueError("numerics", "division", problem)
    if not 0 <= division.iterations <= MAX_ITERATIONS:
        problem = f" newton = {shown(division.iterations)}: 0 to {MAX_ITERATIONS} iterations"
        raise InvalidValueError("numerics", "division", problem)


def _check_functions(functions: FunctionMethod | None) -> None:
    if functions is None or isinstance(functions, Cordic):
        return
    if not isinstance(functions, Interpolation):
        problem = f' = {shown(functions)}: "auto", "cordic" or {{ table = 8 }}'
        raise InvalidValueError("numerics", "functions", problem)
    if not 1 <= functions.index_bits <= MAX_FUNCTION_INDEX_BITS:
        problem = f" table = {shown(functions.index_bits)}: an index has 1 to {MAX_FUNCTION_INDEX_BITS} bits"
        raise InvalidValueError("numerics", "functions", problem)
