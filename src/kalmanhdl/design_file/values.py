"""The values of design files: numbers and expressions, vectors, matrices, words that Python takes too."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import PlainValidator, ValidationInfo

from kalmanhdl.errors import DesignError
from kalmanhdl.model.expression import evaluate
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.numerics.choices import AUTO, DIVISIONS, FUNCTIONS, parse_format
from kalmanhdl.validation import as_real, close, shown

MAX_SIZE = 64

# A constant may have such a name, but is not meant where the word is.
_WORDS = {*DIVISIONS, *FUNCTIONS}

_T = TypeVar("_T")


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
    result = as_real(value)
    if result is None:
        raise ValueError(f'{shown(value)} is no number: write 0.5 or an expression like "pi/90"')
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


def _word_or(word: str, convert: Callable[[Any, ValidationInfo], _T]) -> Callable[..., _T | str]:
    """A validator of what ``convert`` takes, or of a word."""

    def converted(value: Any, info: ValidationInfo) -> _T | str:
        if value == word:
            return word
        try:
            return convert(value, info)
        except ValueError as error:
            if isinstance(value, str) and close(value, [word]):
                raise ValueError(f"{shown(value)} is unknown: did you mean {word!r}?") from None
            raise ValueError(f'{error}; or write "{word}"') from None

    return converted


def _written(value: Any, info: ValidationInfo) -> Any:
    """A choice as Python takes it: expressions worked out, words and all else as they stand."""
    if isinstance(value, dict):
        return {key: _written(each, info) for key, each in value.items()}
    if not isinstance(value, str) or value in _WORDS or parse_format(value) is not None:
        return value
    return _worked_out(value, info)


def _names(value: Any, info: ValidationInfo) -> list[str]:
    if not isinstance(value, list) or len(value) > MAX_SIZE or not all(isinstance(v, str) for v in value):
        raise ValueError(f'{shown(value)} is no list of names: write ["a", "b"], at most {MAX_SIZE}')
    return value


def _axes(value: Any, info: ValidationInfo) -> int | list[str]:
    return _names(value, info) if isinstance(value, list) else _integer(value, info)


def _point(value: Any, info: ValidationInfo) -> str | list[list[float]]:
    return value if isinstance(value, str) else _matrix(value, info)


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
Scale = Annotated[Any, PlainValidator(_word_or(AUTO, _noise))]
Interval = Annotated[Any, PlainValidator(_word_or("bound", _integer))]
Names = Annotated[list[str], PlainValidator(_names)]
Axes = Annotated[int | list[str], PlainValidator(_axes)]
Written = Annotated[Any, PlainValidator(_written)]
Entries = Annotated[list[str | float], PlainValidator(_entries)]
EntryRows = Annotated[list[list[str | float]], PlainValidator(_entry_rows)]
EntryMatrix = Annotated[list[list[str | float]] | list[list[float]], PlainValidator(_entry_matrix)]
Inputs = Annotated[list[RunTimeInput], PlainValidator(_inputs)]
Point = Annotated[str | list[list[float]], PlainValidator(_point)]
Steps = Annotated[str | int, PlainValidator(_word_or(AUTO, _integer))]
