"""A design from TOML text. Everything wrong in it ends as one DesignError that names the place."""

import re
import tomllib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from kalmanhdl.algorithm import ALGORITHMS, Algorithm, Conventional
from kalmanhdl.design import Architecture, Design, Processor, Target
from kalmanhdl.design_file.lines import line_of, twice
from kalmanhdl.design_file.schema import (
    ALGORITHM_TABLES,
    ARCHITECTURES,
    CONTROLS,
    INITIALS,
    MODEL_KINDS,
    MODELS,
    NONLINEAR_INITIALS,
    NUMERICS,
    AffineTable,
    ArchitectureTable,
    CommonModelTable,
    FixedTable,
    FloatTable,
    GivenTable,
    LinearTable,
    MeasuredTable,
    MotionTable,
    MultipleTable,
    NonlinearTable,
    ProcessorTable,
    RootTable,
    Table,
    TargetTable,
    ThreePointTable,
    TwoPointTable,
    VaryingTable,
    WritableTable,
)
from kalmanhdl.design_file.values import Context, number
from kalmanhdl.errors import DesignError, ModelError
from kalmanhdl.model.converted import MEASURED, converted_model
from kalmanhdl.model.expression import MAX_CONSTANTS, RESERVED, ExpressionError, resolve
from kalmanhdl.model.initial import given, three_point, two_point
from kalmanhdl.model.model import Model
from kalmanhdl.model.motion import Motion, constant_acceleration, constant_velocity
from kalmanhdl.model.multiple import MultipleModel, multiple_model
from kalmanhdl.model.nonlinear import Measured, NonlinearModel, nonlinear_model
from kalmanhdl.model.singer import singer
from kalmanhdl.model.state_space import Initial, InitialRule, LinearModel, linear_model
from kalmanhdl.model.turn import coordinated_turn
from kalmanhdl.model.varying import VaryingModel, varying_model
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.specification import SIGNAL_CLASSES, FixedSpecification
from kalmanhdl.shape import Shape
from kalmanhdl.validation import InvalidValueError, identifier_problem, nearest, shown

MAX_BYTES = 1 << 20
MAX_KEYS = 20_000
MAX_DOTS = 6
# The parser's time grows with the square of a dotted key's length.
_DOTTED = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*\.[ \t]*){{{MAX_DOTS + 1}}}""")

_AT_LINE = re.compile(r"\(at line (\d+), column \d+\)\Z")
# How the parser begins to say so.
_TWICE = ("Cannot overwrite a value", "Cannot declare", "Duplicate inline table key", "Cannot mutate")

_T = TypeVar("_T", bound=Table)
_MOTIONS: dict[str, Callable[..., Motion]] = {
    "constant_velocity": constant_velocity,
    "constant_acceleration": constant_acceleration,
    "singer": singer,
    "coordinated_turn": coordinated_turn,
}


def load(path: str | Path, constants: Mapping[str, float | str] | None = None) -> Design:
    """The design of a TOML file; ``constants`` take the place of entries of [model.constants].

    Raises:
        DesignError: the file cannot be read, or says something that cannot be; a constant that the file
            has not.
    """
    name = shown(str(path))[1:-1]
    if not isinstance(constants, Mapping | None):
        raise DesignError(f'constants = {shown(constants)}: write numbers by name, such as {{"T": 1.5}}')
    try:
        with Path(path).open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError, TypeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DesignError(f"{name}: cannot be read: {reason}") from None
    if len(content) > MAX_BYTES:
        raise DesignError(f"{name}: larger than {MAX_BYTES} bytes: a design file is a short text")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DesignError(f"{name}, line {line}: not UTF-8: save the file as UTF-8 text") from None
    return loads(text, name, constants)


def loads(text: str, source: str = "design", constants: Mapping[str, float | str] | None = None) -> Design:
    """The design of TOML text; ``source`` is its name in messages, ``constants`` as for ``load``.

    Raises:
        DesignError: as ``load``.
    """
    tables = _parsed(text, source)
    try:
        return _design(tables, constants or {})
    except InvalidValueError as error:
        line = line_of(text, error.table, error.key)
        place = source if line is None else f"{source}, line {line}"
        kind = ModelError if isinstance(error, ModelError) else DesignError
        raise kind(f"{place}: {error}") from None


def _parsed(text: str, source: str) -> dict[str, Any]:
    if text.count("=") > MAX_KEYS:
        raise DesignError(f"{source}: more than {MAX_KEYS} keys: a design file is a short text")
    dotted = _DOTTED.search(text)
    if dotted:
        line = text.count("\n", 0, dotted.start()) + 1
        raise DesignError(f"{source}, line {line}: not TOML: a key of more than {MAX_DOTS} dots")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise DesignError(f"{source}: not TOML: nested too deeply") from None
    except ValueError as error:
        raise DesignError(_not_toml(text, source, str(error))) from None


def _not_toml(text: str, source: str, reason: str) -> str:
    """What the parser says, and of a key that is set twice, which it does not name, the key and its lines."""
    place = _AT_LINE.search(reason)
    last = int(place[1]) if place else text.count("\n") + 1
    found = twice(text, last) if reason.startswith(_TWICE) else None
    if found is None:
        return f"{source}: not TOML: {reason}"
    name, first, second = found
    where = "stands twice" if first == second else f"stands in line {first} already"
    return f"{source}, line {second}: not TOML: {name} {where}: remove one of the two"


def _design(tables: dict[str, Any], constants: Mapping[str, float | str]) -> Design:
    root = _checked(RootTable, tables, "", Context({}))
    context = Context(_constants(root.model.get("constants", {}), constants))
    model = _model(root.model, context)
    architecture, processor, shape = _architecture(root.architecture, model, context)
    target = _checked(TargetTable, root.target, "target", context)
    return Design(
        name=root.name,
        model=model,
        algorithm=_algorithm(root.algorithm, context),
        numerics=_numerics(root.numerics, context),
        architecture=architecture,
        target=Target(**{name: getattr(target, name) for name in TargetTable.model_fields}),
        processor=processor,
        shape=shape,
    )


def _architecture(
    table: dict[str, Any], model: Model, context: Context
) -> tuple[Architecture, Processor | None, Shape | None]:
    """Hardware of the filter's own, or the processor, or a programmable datapath."""
    kind = _check_kind(ARCHITECTURES, {"kind": "datapath", **table}, "architecture")
    if kind == "processor":
        checked = _checked(ProcessorTable, table, "architecture", context)
        return Architecture(), Processor(**checked.model_dump(exclude={"kind"})), None
    control = table.get("control", "fixed")
    if control not in CONTROLS:
        problem = f" = {shown(control)}: {nearest(str(control), CONTROLS)}"
        raise InvalidValueError("architecture", "control", problem)
    if control == "writable":
        return Architecture(), None, _shape(table, model, context)
    asked = _checked(ArchitectureTable, table, "architecture", context)
    architecture = Architecture(
        interval=asked.interval,
        channels=asked.channels,
        clock_mhz=asked.clock_mhz,
        multiplier_blocks=asked.multiplier_blocks,
        multiplier=asked.multiplier,
        units=asked.units,
        latency=asked.latency,
        clocks=asked.clocks,
        iterative=asked.iterative,
        updates_per_second=asked.updates_per_second,
        solver_seconds=asked.solver_seconds,
        lanes=asked.lanes,
        streams=asked.streams,
        coefficients=asked.coefficients,
    )
    return architecture, None, None


def _shape(table: dict[str, Any], model: Model, context: Context) -> Shape:
    """The shape of a programmable datapath, by default with as many ports as the model needs."""
    for key in table:
        if key in ArchitectureTable.model_fields and key not in WritableTable.model_fields:
            problem = (
                ': control = "writable" is one track on units that any filter can use, whose numbers are in '
                "its image: leave it out"
            )
            raise InvalidValueError("architecture", key, problem)
    asked = _checked(WritableTable, table, "architecture", context)
    ports = {"states": model.n, "measurements": model.m, "controls": model.p}
    given = asked.model_dump(exclude={"kind", "control"}, exclude_none=True)
    return Shape(**{**ports, **given})


def _constants(table: object, instead: Mapping[str, float | str]) -> dict[str, float]:
    """The values of [model.constants], some of them given in place of the file's."""
    if not isinstance(table, dict):
        raise InvalidValueError("model", "constants", f" = {shown(table)}: write [model.constants]")
    if len(table) > MAX_CONSTANTS:
        raise InvalidValueError("model", "constants", f" are {len(table)}: at most {MAX_CONSTANTS}")
    for name in instead:
        if name not in table:
            there = f"its constants are {', '.join(map(str, table))}" if table else "it has no constants"
            called = shown(name)[1:-1] if isinstance(name, str) else shown(name)
            raise InvalidValueError("", f"constant {called}", f" is none of the design: {there}")
    entries: dict[str, float | str] = {}
    for name, value in {**table, **instead}.items():
        problem = identifier_problem(name)
        if problem is None and name in RESERVED:
            problem = f"{shown(name)} has a meaning of its own in expressions: choose another name"
        if problem:
            raise InvalidValueError("model", "constants", f": {problem}")
        try:
            entries[name] = value if isinstance(value, str) else number(value, {})
        except ValueError as error:
            raise _constant_fault(name, str(error), instead) from None
    try:
        return resolve(entries)
    except ExpressionError as error:
        name, _, problem = str(error).partition(": ")
        raise _constant_fault(name, problem, instead) from None


def _constant_fault(name: str, problem: str, instead: Mapping[str, float | str]) -> InvalidValueError:
    if name in instead:
        # No line of the file is to blame.
        return InvalidValueError("", f"constant {name} = {shown(instead[name])}", f": {problem}")
    return InvalidValueError("model.constants", name, f": {problem}")


def _model(table: dict[str, Any], context: Context) -> Model:
    _check_kind(MODEL_KINDS, table, "model")
    match table.get("kind"):
        case MultipleModel.kind:
            return _multiple(table, context)
        case NonlinearModel.kind:
            return _nonlinear(table, context)
        case _:
            return _single(table, context)


def _nonlinear(table: dict[str, Any], context: Context) -> NonlinearModel:
    checked = _checked(NonlinearTable, table, "model", context)
    return nonlinear_model(
        checked.f,
        checked.h,
        checked.Q,
        checked.R,
        initial=_initial(checked.initial, context, NONLINEAR_INITIALS),
        G=checked.G,
        state_names=checked.state,
        state_units=checked.unit,
        measurement_names=checked.measurement,
        measurement_range=checked.measurement_range,
        control_names=checked.control,
        inputs=checked.inputs,
        angles=checked.angles,
        constants=context.constants,
    )


def _multiple(table: dict[str, Any], context: Context) -> MultipleModel:
    """The modes of a table; each is a model of its own that takes what it does not say from the table."""
    own = {key: value for key, value in table.items() if key in MultipleTable.model_fields}
    shared = {key: value for key, value in table.items() if key not in MultipleTable.model_fields}
    checked = _checked(MultipleTable, own, "model", context)
    modes = []
    for mode in checked.modes:
        model = _single({**shared, **mode}, context)
        if not isinstance(model, LinearModel):
            raise InvalidValueError("model", "modes", f": a mode is a linear model, not a {model.kind} one")
        modes.append(model)
    return multiple_model(modes, checked.transition, checked.probabilities)


def _single(table: dict[str, Any], context: Context) -> Model:
    if "inputs" in table:
        return _varying(table, context)
    checked = _of_kind(MODELS, table, "model", context)
    initial = _initial(checked.initial, context)
    assert not isinstance(initial, Measured)
    if isinstance(checked, LinearTable):
        return _linear(checked, initial)
    assert isinstance(checked, MotionTable)
    # The keys of a motion's own are the parameters of its function.
    own = set(type(checked).model_fields) - set(CommonModelTable.model_fields)
    motion = _MOTIONS[checked.kind](**{key: getattr(checked, key) for key in own})
    plots = None if checked.coordinates != "cartesian" else [f"{axis}_plot" for axis in motion.axes]
    return _measured(
        checked,
        F=motion.F,
        H=motion.H,
        Q=motion.Q,
        initial=initial,
        state_names=motion.state_names,
        measurement_names=checked.measurement or plots,
    )


def _varying(table: dict[str, Any], context: Context) -> VaryingModel:
    if table.get("kind") != LinearModel.kind:
        kind = shown(table.get("kind"))
        problem = f': kind = {kind} has none: write its matrices by formulas, with kind = "linear"'
        raise InvalidValueError("model", "inputs", problem)
    checked = _checked(VaryingTable, table, "model", context)
    initial = _initial(checked.initial, context)
    assert not isinstance(initial, Measured)
    return varying_model(
        checked.F,
        checked.H,
        checked.Q,
        checked.R,
        inputs=checked.inputs,
        initial=initial,
        B=checked.B,
        offset=checked.offset,
        measurement_offset=checked.measurement_offset,
        constants=context.constants,
        state_names=checked.state,
        state_units=checked.unit,
        measurement_names=checked.measurement,
        control_names=checked.control,
        measurement_range=checked.measurement_range,
    )


def _linear(table: LinearTable, initial: Initial | InitialRule) -> Model:
    return _measured(
        table,
        F=table.F,
        H=table.H,
        Q=table.Q,
        initial=initial,
        B=table.B,
        offset=table.offset,
        state_names=table.state,
        measurement_names=table.measurement,
        control_names=table.control,
    )


def _measured(table: CommonModelTable, *, H: ArrayLike, **keys: Any) -> Model:
    """The model of a linear motion whose measurements are in the coordinates that a table says."""
    keys |= {"R": table.R, "state_units": table.unit, "measurement_range": table.measurement_range}
    if table.coordinates == "cartesian":
        return linear_model(H=H, measurement_offset=table.measurement_offset, **keys)
    if table.measurement_offset is not None:
        problem = ": measurements that are converted have none: take it off the data"
        raise InvalidValueError("model", "measurement_offset", problem)
    names = MEASURED[table.coordinates]
    if len(np.asarray(H)) != len(names):
        problem = f" = {shown(table.coordinates)} takes {len(names)} axes: {', '.join(names)} are measured"
        raise InvalidValueError("model", "coordinates", problem)
    return converted_model(H=H, **keys)


def _initial(
    table: dict[str, Any], context: Context, kinds: Mapping[str, type[Table]] = INITIALS
) -> Initial | InitialRule | Measured:
    checked = _of_kind(kinds, table, "model.initial", context)
    if isinstance(checked, MeasuredTable):
        return Measured(checked.x, checked.P)
    if isinstance(checked, GivenTable):
        return given(checked.x, checked.P, at=checked.at)
    if isinstance(checked, ThreePointTable):
        return three_point(P=checked.P)
    if isinstance(checked, TwoPointTable):
        return two_point(P=checked.P)
    assert isinstance(checked, AffineTable)
    return Initial(
        x=np.array(checked.x),
        from_measurement=np.array(checked.from_measurement),
        from_state=np.array(checked.from_state),
        from_control=None if checked.from_control is None else np.array(checked.from_control),
        from_noise=None if checked.from_noise is None else np.array(checked.from_noise),
        P=np.array(checked.P),
        points=checked.points,
        before_update=checked.before_update,
    )


def _algorithm(table: dict[str, Any], context: Context) -> Algorithm:
    checked = _of_kind(ALGORITHM_TABLES, {"kind": Conventional.kind, **table}, "algorithm", context)
    return ALGORITHMS[checked.kind](**checked.model_dump(exclude={"kind"}, exclude_unset=True))


def _numerics(table: dict[str, Any], context: Context) -> FixedSpecification | FloatSpecification:
    checked = _of_kind(NUMERICS, {"kind": "fixed", **table}, "numerics", context)
    if isinstance(checked, FloatTable):
        return FloatSpecification(**checked.model_dump(exclude={"kind"}))
    assert isinstance(checked, FixedTable)
    return FixedSpecification(
        width=checked.width,
        classes=checked.classes(SIGNAL_CLASSES),
        signals=checked.signals,
        rounding=checked.rounding,
        overflow=checked.overflow,
        scale=checked.scale,
        covariance_scale=checked.covariance_scale,
        division=checked.division,
        functions=checked.functions,
        coast=checked.coast,
        headroom=checked.headroom,
    )


def _of_kind(kinds: Mapping[str, type[_T]], table: dict[str, Any], where: str, context: Context) -> _T:
    """The table, checked by the class that its ``kind`` names."""
    return _checked(kinds[_check_kind(kinds, table, where)], table, where, context)


def _check_kind(kinds: Collection[str], table: dict[str, Any], where: str) -> str:
    kind = table.get("kind")
    if isinstance(kind, str) and kind in kinds:
        return kind
    if kind is None:
        raise InvalidValueError(where, "kind", f" is missing: valid are {', '.join(kinds)}")
    raise InvalidValueError(where, "kind", f" = {shown(kind)} is unknown: {nearest(str(kind), kinds)}")


def _checked(table_class: type[_T], table: dict[str, Any], where: str, context: Context) -> _T:
    # First of all: a misspelt key is also a missing one, and the spelling is what helps.
    for key in table:
        if key not in table_class.model_fields:
            hint = nearest(key, table_class.model_fields)
            raise InvalidValueError(where, shown(key)[1:-1], f" is an unknown key: {hint}")
    try:
        return table_class.model_validate(table, context=context)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    raise _fault(first, where)


def _fault(detail: ErrorDetails, where: str) -> InvalidValueError:
    key, *inner = detail["loc"]
    if inner and isinstance(inner[0], str):
        where, key = ".".join(filter(None, (where, str(key)))), inner[0]
    key = str(key)
    match detail["type"]:
        case "missing":
            return InvalidValueError(where, key, " is missing")
        case "value_error":
            message = str(detail["ctx"]["error"])
            return InvalidValueError(where, key, message if message.startswith("[") else f": {message}")
        case "dict_type":
            name = f"{where}.{key}" if where else key
            header = f"[[{name}]]" if inner else f"[{name}]"
            problem = f" = {shown(detail['input'])}: write a table, with its keys below {header}"
            return InvalidValueError(where, key, problem)
        case "string_type":
            return InvalidValueError(where, key, f" = {shown(detail['input'])}: write a string")
        case "list_type" | "tuple_type":
            return InvalidValueError(where, key, f" = {shown(detail['input'])}: write a list like [...]")
        case "bool_type":
            return InvalidValueError(where, key, f" = {shown(detail['input'])}: true or false")
        case _:
            rule = detail["msg"].removeprefix("Input should be ")
            return InvalidValueError(where, key, f" = {shown(detail['input'])}: write {rule}")
