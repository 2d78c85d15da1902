"""The values of design files: numbers and expressions, vectors, matrices, formats."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import PlainValidator, ValidationInfo

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import DesignError
from kalmanhdl.model.expression import evaluate
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.numerics.functions.method import Cordic, FunctionMethod, Interpolation
from kalmanhdl.numerics.specification import MAX_FRACTION, MAX_WIDTH, Form, parse_format
from kalmanhdl.validation import nearest, shown

MAX_SIZE = 64


@dataclass(frozen=True, slots=True)
class Context:
    """What the validators know besides the value."""

    constants: Mapping[str, float]


def number(value: object, constants: Mapping[str, float]) -> float:
    """A finite real number, written as one or as an expression."""
    if isinstance(value, str):
        try:
            return evaluate(value, constants)
        except DesignError as error:
            raise ValueError(str(error)) from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f'{shown(value)} is no number: write 0.5 or an expression like "pi/90"')
    try:
        result = float(value)
    except OverflowError:
        raise ValueError(f"{shown(value)} is too large for a number") from None
    if not abs(result) < float("inf"):
        raise ValueError(f"{shown(value)} is not finite: write a finite number")
    return result


def _constants(info: ValidationInfo) -> Mapping[str, float]:
    context = info.context
    assert isinstance(context, Context)
    return context.constants


def _number(value: Any, info: ValidationInfo) -> float:
    return number(value, _constants(info))


def _integer(value: Any, info: ValidationInfo) -> int:
    result = number(value, _constants(info))
    if not result.is_integer() or abs(result) > 2**53:
        raise ValueError(f"{shown(value)} is no integer: write one, such as 16")
    return int(result)


def vector(value: object, constants: Mapping[str, float]) -> list[float]:
    """A list of numbers."""
    if not isinstance(value, list):
        raise ValueError(f"{shown(value)} is no list: write one like [1, 0.5]")
    if len(value) > MAX_SIZE:
        raise ValueError(f"{len(value)} numbers: at most {MAX_SIZE}")
    result = []
    for i, entry in enumerate(value):
        try:
            result.append(number(entry, constants))
        except ValueError as error:
            raise ValueError(f"[{i}]: {error}") from None
    return result


def _vector(value: Any, info: ValidationInfo) -> list[float]:
    return vector(value, _constants(info))


def _matrix(value: Any, info: ValidationInfo) -> list[list[float]]:
    constants = _constants(info)
    if isinstance(value, dict):
        if list(value) != ["diagonal"]:
            raise ValueError(f"{shown(value)} is no matrix: write [[...], ...] or {{ diagonal = [...] }}")
        diagonal = vector(value["diagonal"], constants)
        return [[d if i == j else 0.0 for j in range(len(diagonal))] for i, d in enumerate(diagonal)]
    if not isinstance(value, list) or not value:
        raise ValueError(f"{shown(value)} is no matrix: write [[...], ...] or {{ diagonal = [...] }}")
    if len(value) > MAX_SIZE:
        raise ValueError(f"{len(value)} rows: at most {MAX_SIZE}")
    rows = []
    for i, row in enumerate(value):
        try:
            rows.append(vector(row, constants))
        except ValueError as error:
            raise ValueError(f"[{i}]{'' if str(error).startswith('[') else ': '}{error}") from None
        if len(rows[-1]) != len(rows[0]):
            raise ValueError(f"[{i}] has {len(rows[-1])} numbers but [0] has {len(rows[0])}: make rows equal")
    return rows


def _noise(value: Any, info: ValidationInfo) -> float | list[float]:
    return _vector(value, info) if isinstance(value, list) else _number(value, info)


def _scale(value: Any, info: ValidationInfo) -> Literal["auto"] | float | tuple[float, ...]:
    if value == "auto":
        return "auto"
    return tuple(_vector(value, info)) if isinstance(value, list) else _number(value, info)


def _scales(value: Any, info: ValidationInfo) -> Literal["auto"] | tuple[float, ...]:
    scale = _scale(value, info)
    if isinstance(scale, float):
        raise ValueError(f'{shown(value)} is no list: write "auto" or one number a state')
    return scale


def _names(value: Any, info: ValidationInfo) -> list[str]:
    if not isinstance(value, list) or len(value) > MAX_SIZE or not all(isinstance(v, str) for v in value):
        raise ValueError(f'{shown(value)} is no list of names: write ["a", "b"], at most {MAX_SIZE}')
    return value


def _axes(value: Any, info: ValidationInfo) -> int | list[str]:
    return _names(value, info) if isinstance(value, list) else _integer(value, info)


def _form(value: Any, info: ValidationInfo) -> Form:
    rule = 'write a width like 16, a format like "Q12.20", or { width = 20, fraction = 4, signed = true }'
    if isinstance(value, dict):
        unknown = [key for key in value if key not in ("width", "fraction", "signed")]
        if unknown:
            hint = nearest(unknown[0], ("width", "fraction", "signed"))
            raise ValueError(f"{shown(unknown[0])} is no key of a format: {hint}")
        signed = value.get("signed", True)
        if "width" not in value or "fraction" not in value or not isinstance(signed, bool):
            raise ValueError(f"{shown(value)} is no format: {rule}")
        width, fraction = _integer(value["width"], info), _integer(value["fraction"], info)
        if not 1 <= width <= MAX_WIDTH or abs(fraction) > MAX_FRACTION:
            limits = f"a width is 1 to {MAX_WIDTH}, a fraction -{MAX_FRACTION} to {MAX_FRACTION}"
            raise ValueError(f"{shown(value)} is no format: {limits}")
        return Fixed(width=width, fraction=fraction, signed=signed)
    if isinstance(value, str):
        form = parse_format(value)
        if form is not None:
            return form
    try:
        return _integer(value, info)
    except ValueError:
        raise ValueError(f"{shown(value)} is no format: {rule}") from None


def _forms(value: Any, info: ValidationInfo) -> dict[str, Form]:
    if not isinstance(value, dict):
        raise ValueError(f'{shown(value)} is no table: write [numerics.signals] and "P[0,0]" = 20')
    if len(value) > 2 * MAX_SIZE**2:
        raise ValueError(f"{len(value)} signals: at most {2 * MAX_SIZE**2}")
    result = {}
    for name, entry in value.items():
        try:
            result[name] = _form(entry, info)
        except ValueError as error:
            raise ValueError(f"{shown(name)}: {error}") from None
    return result


def _division(value: Any, info: ValidationInfo) -> DivisionMethod:
    if value in ("radix2", "radix4"):
        return LongDivision(radix=int(value[-1]))
    if isinstance(value, dict) and "table" in value and set(value) <= {"table", "newton"}:
        newton = _integer(value.get("newton", 0), info)
        return TableNewton(index_bits=_integer(value["table"], info), iterations=newton)
    raise ValueError(f'{shown(value)}: write "radix2", "radix4" or {{ table = 10, newton = 0 }}')


def _functions(value: Any, info: ValidationInfo) -> FunctionMethod | None:
    if value == "auto":
        return None
    if value == "cordic":
        return Cordic()
    if isinstance(value, dict) and set(value) == {"table"}:
        return Interpolation(index_bits=_integer(value["table"], info))
    raise ValueError(f'{shown(value)}: write "auto", "cordic" or {{ table = 8 }}')


def _point(value: Any, info: ValidationInfo) -> str | list[list[float]]:
    return value if isinstance(value, str) else _matrix(value, info)


def _steps(value: Any, info: ValidationInfo) -> Literal["auto"] | int:
    return "auto" if value == "auto" else _integer(value, info)


def _entries(value: Any, info: ValidationInfo) -> list[str | float]:
    """Formulas: strings, which the model reads, and numbers."""
    if not isinstance(value, list):
        raise ValueError(f'{shown(value)} is no list: write one like ["x + T*v", "v"]')
    if len(value) > MAX_SIZE:
        raise ValueError(f"{len(value)} formulas: at most {MAX_SIZE}")
    result: list[str | float] = []
    for i, entry in enumerate(value):
        try:
            result.append(entry if isinstance(entry, str) else number(entry, {}))
        except ValueError as error:
            raise ValueError(f"[{i}]: {error}") from None
    return result


def _entry_rows(value: Any, info: ValidationInfo) -> list[list[str | float]]:
    if not isinstance(value, list) or len(value) > MAX_SIZE:
        raise ValueError(f'{shown(value)} is no matrix: write [["T^2/2"], ["T"]], at most {MAX_SIZE} rows')
    return [_entries(row, info) for row in value]


def _entry_matrix(value: Any, info: ValidationInfo) -> list[list[str | float]] | list[list[float]]:
    """A matrix of numbers and, in a table with inputs, formulas that name them."""
    if not info.data.get("inputs"):
        return _matrix(value, info)
    if isinstance(value, dict) and list(value) == ["diagonal"]:
        diagonal = _entries(value["diagonal"], info)
        rows = [[d if i == j else 0.0 for j in range(len(diagonal))] for i, d in enumerate(diagonal)]
    else:
        rows = _entry_rows(value, info)
    return [[_worked_out(entry, info) for entry in row] for row in rows]


def _worked_out(entry: str | float, info: ValidationInfo) -> str | float:
    """A number where an entry names constants alone, else the formula, which the model reads."""
    try:
        return number(entry, _constants(info))
    except ValueError:
        return entry


def _inputs(value: Any, info: ValidationInfo) -> list[RunTimeInput]:
    if not isinstance(value, dict):
        raise ValueError(f"{shown(value)} is no table: write [model.inputs] and dt = [0.5, 5]")
    found = []
    for name, entry in value.items():
        table = entry if isinstance(entry, dict) else {"range": entry}
        try:
            limits = vector(table.get("range"), _constants(info))
            if len(limits) != 2 or not set(table) <= {"range", "from"} or table.get("from", "time") != "time":
                raise ValueError(f"{shown(entry)} is no input")
        except ValueError as error:
            rule = 'write a range like [0.5, 5], or { range = [0.5, 5], from = "time" }'
            raise ValueError(f"{shown(name)}: {error}: {rule}") from None
        low, high = limits
        found.append(RunTimeInput(name=name, low=low, high=high, from_time="from" in table))
    return found


Number = Annotated[float, PlainValidator(_number)]
Integer = Annotated[int, PlainValidator(_integer)]
Vector = Annotated[list[float], PlainValidator(_vector)]
Matrix = Annotated[list[list[float]], PlainValidator(_matrix)]
Noise = Annotated[float | list[float], PlainValidator(_noise)]
Scale = Annotated[Literal["auto"] | float | tuple[float, ...], PlainValidator(_scale)]
Scales = Annotated[Literal["auto"] | tuple[float, ...], PlainValidator(_scales)]
Names = Annotated[list[str], PlainValidator(_names)]
Axes = Annotated[int | list[str], PlainValidator(_axes)]
FormValue = Annotated[Form, PlainValidator(_form)]
Entries = Annotated[list[str | float], PlainValidator(_entries)]
EntryRows = Annotated[list[list[str | float]], PlainValidator(_entry_rows)]
EntryMatrix = Annotated[list[list[str | float]] | list[list[float]], PlainValidator(_entry_matrix)]
Inputs = Annotated[list[RunTimeInput], PlainValidator(_inputs)]
Forms = Annotated[dict[str, Form], PlainValidator(_forms)]
Division = Annotated[DivisionMethod, PlainValidator(_division)]
Functions = Annotated[FunctionMethod | None, PlainValidator(_functions)]
Point = Annotated[str | list[list[float]], PlainValidator(_point)]
Steps = Annotated[Literal["auto"] | int, PlainValidator(_steps)]
