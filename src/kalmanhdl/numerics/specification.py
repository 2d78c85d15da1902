"""What a design asks of its number formats. The formats themselves are chosen from it later."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, TypeVar

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision
from kalmanhdl.arithmetic.fixed import Overflow, Rounding
from kalmanhdl.numerics.choices import (
    Form,
    as_division,
    as_form,
    as_functions,
    as_scale,
    as_scales,
    as_width,
)
from kalmanhdl.numerics.functions.method import FunctionMethod
from kalmanhdl.validation import InvalidValueError, integer, nearest, shown

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


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedSpecification:
    """Fixed-point arithmetic as the user asks for it, in values or in the words of a design file.

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
        found = {
            "rounding": _mode("rounding", self.rounding, Rounding),
            "overflow": _mode("overflow", self.overflow, Overflow),
            "classes": _formats("numerics", "classes", self.classes, _class_problem),
            "signals": _formats("numerics.signals", "signals", self.signals, _signal_problem),
            "headroom": _headroom(self.headroom),
            "coast": integer("numerics", "coast", self.coast, 0, MAX_COAST),
        }
        for key, convert in _CONVERSIONS.items():
            found[key] = _converted("numerics", key, getattr(self, key), convert)
        for key, value in found.items():
            object.__setattr__(self, key, value)

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


_Mode = TypeVar("_Mode", Rounding, Overflow)
_Value = TypeVar("_Value")


def _mode(key: str, value: object, modes: type[_Mode]) -> _Mode:
    """A mode, or the word for it as a design file has it."""
    try:
        return modes(value)
    except ValueError:
        words = ", ".join(mode.value for mode in modes)
        raise InvalidValueError("numerics", key, f" = {shown(value)}: one of {words}") from None


_CONVERSIONS: Mapping[str, Callable[[object], object]] = MappingProxyType(
    {
        "width": as_width,
        "scale": as_scales,
        "covariance_scale": as_scale,
        "division": as_division,
        "functions": as_functions,
    }
)


def _converted(table: str, key: str, value: object, convert: Callable[[object], _Value]) -> _Value:
    try:
        return convert(value)
    except ValueError as error:
        raise InvalidValueError(table, key, str(error)) from None


def _formats(
    table: str, key: str, given: object, problem: Callable[[object], InvalidValueError | None]
) -> dict[str, Form]:
    """A format by name, where ``problem`` says what is wrong with a name."""
    if not isinstance(given, Mapping):
        rule = 'write a format by name, such as {"P[0,0]": 20} or {"state": "Q12.20"}'
        raise InvalidValueError("numerics", key, f" = {shown(given)}: {rule}")
    for name in given:
        found = problem(name)
        if found is not None:
            raise found
    return {name: _converted(table, name, form, as_form) for name, form in given.items()}


def _class_problem(name: object) -> InvalidValueError | None:
    if isinstance(name, str) and name in SIGNAL_CLASSES:
        return None
    hint = nearest(str(name), SIGNAL_CLASSES)
    called = shown(name)[1:-1] if isinstance(name, str) else shown(name)
    return InvalidValueError("numerics", called, f" is no signal class: {hint}")


def _signal_problem(name: object) -> InvalidValueError | None:
    if isinstance(name, str) and SIGNAL.match(name):
        return None
    problem = f'{shown(name)} is no signal: write it like "x[0]" or "P[0,1]"'
    return InvalidValueError("numerics.signals", "", problem)


def _headroom(given: object) -> dict[str, int]:
    if not isinstance(given, Mapping):
        rule = 'write bits by name, such as {"gain": 1} or {"P[0,0]": 2}'
        raise InvalidValueError("numerics", "headroom", f" = {shown(given)}: {rule}")
    for name in given:
        if _class_problem(name) is not None and _signal_problem(name) is not None:
            problem = f'{shown(name)} is neither a signal, such as "P[0,1]", nor a class of signals'
            raise InvalidValueError("numerics.headroom", "", problem)
    return {name: integer("numerics.headroom", name, bits, 0, MAX_HEADROOM) for name, bits in given.items()}
