"""A floating-point graph as straight-line C over groups of tracks, on the types of ``float.h``."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import assert_never

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Constant,
    Divide,
    Input,
    Multiply,
    Negative,
    Not,
    NotFinite,
    Operation,
    Or,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    StateFlag,
    Subtract,
    SumOfProducts,
    SumOutside,
    Table,
    Unary,
    is_flag,
)
from kalmanhdl.graph.operations import Flag as FlagInput
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.simulate.assembly import Body, Parts, assembled, next_state, usual_flags
from kalmanhdl.simulate.expression import FLAG, Flag, Kind, Writer
from kalmanhdl.simulate.program import INITIALISE, FloatKind, Port, Program

# Formats whose rounded arithmetic processors have, and their types in float.h.
_NATIVE = {Float(8, 23): "binary32", Float(11, 52): "binary64"}
# What doubles can hold, and round rightly a second time; what a product of two can have in 128 bits.
_DOUBLES_EXPONENT, _DOUBLES_MANTISSA = 9, 24
_SOFT_WIDTH, _SOFT_MANTISSA = 64, 58


def float_header(forms: Iterable[Float]) -> list[str]:
    """The C that programs in these formats need."""
    forms = list(dict.fromkeys(form for form in forms if is_compiled(form)))
    if not forms:
        return []
    header = (files("kalmanhdl.simulate") / "float.h").read_text(encoding="utf-8")
    return [header, *(_definition(form) for form in forms if form not in _NATIVE)]


def is_compiled(form: Float) -> bool:
    """Whether the C has a format."""
    return form.width <= _SOFT_WIDTH and form.mantissa <= _SOFT_MANTISSA


def _in_doubles(form: Float) -> bool:
    return form.exponent <= _DOUBLES_EXPONENT and form.mantissa <= _DOUBLES_MANTISSA


def _kind(form: Float) -> FloatKind:
    toward_zero = "z" if form.rounding is Rounding.TOWARD_ZERO else ""
    own = f"f{form.exponent}_{form.mantissa}{toward_zero}{'' if form.subnormals else 'n'}"
    return FloatKind(_NATIVE.get(form, own), form.width)


def _definition(form: Float) -> str:
    macro, kind = ("DOUBLES" if _in_doubles(form) else "SOFT"), _kind(form)
    size = next(size for size in (16, 32, 64) if form.width <= size)
    toward_zero = int(form.rounding is Rounding.TOWARD_ZERO)
    fields = f"{form.exponent}, {form.mantissa}, {toward_zero}, {int(form.subnormals)}"
    return f"{macro}({kind.c_type}, uint{size}_t, {fields})"


def float_program(name: str, typed: FloatGraph) -> Program:
    """The C of one graph; without text where the C does not have its format."""
    operations, kind = typed.graph.operations, _kind(typed.form)

    def port(key: str, index: int) -> Port:
        if is_flag(operations[index]):
            return Port(name=key, index=index, kind=Kind.INT32, low=-1, high=0, flag=True)
        high = (1 << typed.form.width) - 1
        return Port(name=key, index=index, kind=kind, low=0, high=high, flag=False)

    places = {o.name: i for i, o in enumerate(operations) if isinstance(o, State | StateFlag)}
    inputs = tuple(port(o.name, i) for i, o in enumerate(operations) if isinstance(o, Input))
    flags = tuple(port(o.name, i) for i, o in enumerate(operations) if isinstance(o, FlagInput))
    states = tuple(port(key, places.get(key, root)) for key, root in typed.graph.states)
    outputs = tuple(port(key, root) for key, root in typed.graph.outputs)
    text = ""
    if is_compiled(typed.form):
        lowering = _lowered(typed, name, {})
        usually = _lowered(typed, name, usual_flags(flag.name for flag in flags))
        seen = [f"w->counts[{n}] -= {flag.c} & in->live;" for n, flag in enumerate(_unbounded(lowering))]
        parts = Parts(
            name=name,
            inputs=inputs,
            flags=flags,
            states=states,
            outputs=outputs,
            watched=(),
            counts=len(typed.violations),
            step=_body(lowering, states, outputs, _hits(lowering)),
            usual=_body(usually, states, outputs, _hits(usually)),
            watch=_body(lowering, states, outputs, seen),
        )
        text = "\n".join([*lowering.tables, assembled(parts)])
    return Program(
        name=name,
        text=text,
        bits=0,
        inputs=inputs,
        flags=flags,
        states=states,
        outputs=outputs,
        counted=(),
        violations=tuple(v.value for v in typed.violations),
        watched=(),
    )


@dataclass(slots=True)
class _Lowering:
    """The C expressions of a graph's operations: variables and constants for numbers, flags for flags.

    ``given`` are the flags of commands that are known when the C is written.
    """

    typed: FloatGraph
    name: str
    type: str
    given: Mapping[str, bool]
    writer: Writer = field(default_factory=Writer)
    signals: list[str | Flag] = field(default_factory=list)
    tables: list[str] = field(default_factory=list)

    def number(self, index: int) -> str:
        """The expression of a number."""
        signal = self.signals[index]
        assert isinstance(signal, str)
        return signal

    def flag(self, index: int) -> Flag:
        """The expression of a flag."""
        signal = self.signals[index]
        assert isinstance(signal, Flag)
        return signal

    def text(self, index: int) -> str:
        """The expression of either."""
        signal = self.signals[index]
        return signal.c if isinstance(signal, Flag) else signal

    def call(self, function: str, *arguments: str) -> str:
        """The variable of a function's value."""
        return self.writer.bind(self.type, f"{function}_{self.type}({', '.join(arguments)})")

    def element(self, raw: int) -> str:
        """A number as one element of a vector."""
        form = self.typed.form
        if form not in _NATIVE and not _in_doubles(form):
            return f"{raw:#x}ULL"
        value = float(form.real(raw))
        return f"{value.hex()}{'f' if self.type == 'binary32' else ''}"

    def constant(self, raw: int) -> str:
        """A number in every lane."""
        return f"all_{self.type}({self.element(raw)})"


def _lowered(typed: FloatGraph, name: str, given: Mapping[str, bool]) -> _Lowering:
    lowering = _Lowering(typed, name, _kind(typed.form).c_type, given)
    for index, operation in enumerate(typed.graph.operations):
        lowering.signals.append("" if index in typed.fused else _signal(lowering, index, operation))
    return lowering


def _signal(lowering: _Lowering, index: int, operation: Operation) -> str | Flag:
    writer, form, number, flag = lowering.writer, lowering.typed.form, lowering.number, lowering.flag
    match operation:
        case Input():
            return writer.bind(lowering.type, f"in->x{index}")
        case State():
            return writer.bind(lowering.type, f"old->x{index}")
        case FlagInput(name) if name in lowering.given:
            return Flag(writer, "", lowering.given[name])
        case FlagInput():
            return writer.flag(f"in->x{index}")
        case StateFlag():
            return writer.flag(f"old->x{index}")
        case Constant(value):
            return lowering.constant(form.nearest(value))
        case Add(a, b) | Subtract(a, b):
            return _sum(lowering, index, a, b, isinstance(operation, Subtract))
        case Multiply(a, b):
            return lowering.call("multiply", number(a), number(b))
        case Shift(a, exponent):
            return _scaled(lowering, number(a), exponent)
        case Divide(a, b):
            return lowering.call("divide", number(a), number(b))
        case Reciprocal(a):
            return lowering.call("divide", lowering.constant(form.nearest(1.0)), number(a))
        case Unary(function, a):
            return lowering.call(function.value, number(a))
        case Table(a, rows):
            return _row(lowering, number(a), [form.nearest(row) for row in rows])
        case Select(condition, a, b) if (known := flag(condition).known) is not None:
            return number(a if known else b)
        case Select(condition, a, b):
            return lowering.call("select", flag(condition).c, number(a), number(b))
        case NotFinite(a):
            return writer.flag(f"unbounded_{lowering.type}({number(a)})")
        case Negative(a):
            return writer.flag(f"negative_{lowering.type}({number(a)})")
        case And(a, b):
            return flag(a) & flag(b)
        case Or(a, b):
            return flag(a) | flag(b)
        case Not(a):
            return flag(a).negated()
        case Quantise() | Bits() | Outside() | SumOfProducts() | SumOutside() | Binary():
            raise AssertionError(f"{operation} in a graph of floating-point numbers")
        case _ as never:
            assert_never(never)


def _sum(lowering: _Lowering, index: int, a: int, b: int, is_difference: bool) -> str:
    typed, number = lowering.typed, lowering.number

    def signed(index: int, negative: bool) -> str:
        return lowering.call("negate", number(index)) if negative else number(index)

    fused = typed.fused_sum(index)
    if fused is not None:
        factors = typed.graph.operations[fused.product]
        assert isinstance(factors, Multiply)
        first, added = signed(factors.a, fused.minus_product), signed(fused.addend, fused.minus_addend)
        return lowering.call("fused", first, number(factors.b), added)
    return lowering.call("subtract" if is_difference else "add", number(a), number(b))


def _scaled(lowering: _Lowering, text: str, exponent: int) -> str:
    """A product with a power of two, which every carrier has in one rounding."""
    form = lowering.typed.form
    if abs(exponent) < form.bias:
        power = (exponent + form.bias) << form.mantissa
        return lowering.call("multiply", text, lowering.constant(power))
    return lowering.call("scale", text, str(exponent))


def _row(lowering: _Lowering, text: str, raws: Sequence[int]) -> str:
    element = {"binary32": "float", "binary64": "double"}.get(lowering.type)
    element = element or ("double" if _in_doubles(lowering.typed.form) else "int64_t")
    table = f"{lowering.name}_table_{len(lowering.tables)}"
    rows = ", ".join(map(lowering.element, raws))
    lowering.tables.append(f"static const {element} {table}[] = {{{rows}}};")
    index = lowering.writer.bind(FLAG, f"index_{lowering.type}({text}, {len(raws) - 1})")
    return lowering.call("row", table, index)


def _unbounded(lowering: _Lowering) -> list[Flag]:
    """For each of the graph's violations the flag that it happens, where it matters."""
    operations = enumerate(lowering.typed.graph.operations)
    command = next((k for k, o in operations if isinstance(o, FlagInput) and o.name == INITIALISE), None)
    starts = Flag(lowering.writer, "", False) if command is None else lowering.flag(command)
    flags = []
    for violation in lowering.typed.violations:
        text = f"unbounded_{lowering.type}({lowering.number(violation.value)})"
        flag = lowering.writer.flag(text)
        if not (violation.starting and violation.running):
            flag = flag & (starts if violation.starting else starts.negated())
        flags.append(flag)
    return flags


def _hits(lowering: _Lowering) -> list[str]:
    return [f"out->hit |= {flag.c};" for flag in _unbounded(lowering)]


def _body(
    lowering: _Lowering, states: Sequence[Port], outputs: Sequence[Port], further: Sequence[str]
) -> Body:
    """A step that gives new states and outputs, and has further lines that use its variables."""
    pairs = zip(states, lowering.typed.graph.states, strict=True)
    following = [next_state(port, lowering.text(root)) for port, (_, root) in pairs]
    shown = dict.fromkeys(f"out->x{port.index} = {lowering.text(port.index)};" for port in outputs)
    return Body(lowering.writer.statements, [*following, *shown, *further])
