"""From a graph of reals to a graph of integers.

Every named signal (a state, a gain, an innovation) and every operand of a multiplication or division is
brought into a format once; sums in between are exact. Constant multiplications become shifts and adds, or
wait for a multiplier where few are shared.
"""

import math
from fractions import Fraction

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, rounded
from kalmanhdl.errors import FormatError
from kalmanhdl.graph.builder import Builder, reachable
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Bits,
    Coefficient,
    Constant,
    Divide,
    Flag,
    Function,
    Graph,
    Input,
    Multiply,
    Operation,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    Subtract,
    Table,
    Unary,
    is_flag,
)
from kalmanhdl.graph.simplify import TERM
from kalmanhdl.numerics.functions.circuit import Circuit
from kalmanhdl.numerics.functions.lowering import REACH, lowered
from kalmanhdl.numerics.functions.method import method_for
from kalmanhdl.numerics.interval import Typed, least_divisor, reciprocal_interval, smallest, type_of
from kalmanhdl.numerics.ranges import Ranges, cone
from kalmanhdl.numerics.saturated import NAME, sticky
from kalmanhdl.numerics.signals import SignalName, signal_of
from kalmanhdl.numerics.signed_digits import multiplied
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.typed import Interval, TypedGraph, Violation
from kalmanhdl.validation import InvalidValueError, nearest

_TINY = 2.0**-64
# An operand of a constant multiplication may be this many bits wider than its format before it is rounded.
_GUARD = 4
# How far beyond the values that were observed a format reaches, per class.
# Innovations of real sensors, with their outliers and biases, go far beyond those of the model.
# Rounding and approximate reciprocals bring a covariance a little above what it is in real numbers.
MARGIN = {
    "covariance": 1.0625,
    "innovation_covariance": 1.0625,
    "state": 1.25,
    "measurement": 1.25,
    "innovation": 4.0,
    "product": 4.0,
    "nis": 8.0,
    "control": 2.0,
    # Of coefficients, which other models have as well; numbers that stay need none.
    "constant": 2.0,
}


def margin(ranges: Ranges, index: int, signal_class: str) -> float:
    """How far beyond its range the format of an operation reaches; what is declared keeps its limits."""
    return 1.0 if index in ranges.declared else MARGIN.get(signal_class, 1.0)


# Their arguments are squared, or turned with as many bits as they have.
_OF_POINTS = (Function.ARCTANGENT, Function.HYPOTENUSE)


def quantise(
    graph: Graph,
    ranges: Ranges,
    specification: FixedSpecification,
    scales: dict[str, float],
    *,
    on_multipliers: bool = False,
) -> TypedGraph:
    """The typed graph of a graph of reals whose operations take values within ``ranges``.

    Constants multiply by shifts and adds, or ``on_multipliers``. Sums of shifted values have wider bounds
    than products, so that an operand may be rounded before the one and not before the other.

    Raises:
        FormatError: a constant of the model does not fit the format that the design gives its signal.
        DesignError: the design gives a format to a signal that the graph has not.
    """
    lowering = _Lowering(graph, ranges, specification, on_multipliers)
    states = [(name, lowering.state(name, root)) for name, root in graph.states]
    outputs = [(name, lowering.output(root)) for name, root in graph.outputs]
    kept_state = dict(states)
    outputs = [(name, kept_state.get(name, index)) for name, index in outputs]
    typed = lowering.finished(states, outputs, scales)
    _check_signals(specification, lowering.signals)
    return typed


def _check_signals(specification: FixedSpecification, known: set[str]) -> None:
    """A format for a number that the hardware does not compute would be lost without a word."""
    for name in specification.signals:
        if name not in known:
            problem = f" is a constant here or no signal of this filter: {nearest(name, sorted(known))}"
            raise InvalidValueError("numerics.signals", name, problem)


class _Lowering:
    """One pass over a graph; keeps for every operation of reals the exact integer value it became."""

    def __init__(
        self, graph: Graph, ranges: Ranges, specification: FixedSpecification, on_multipliers: bool
    ) -> None:
        self.graph, self.ranges, self.specification = graph, ranges, specification
        self.on_multipliers = on_multipliers
        self.builder = Builder()
        self.types: list[Typed | None] = []
        self.given: dict[int, Fixed] = {}
        self.exact: dict[int, int] = {}
        self.circuit = Circuit(self.builder, self.type, {})
        # The names of the numbers that were given a format.
        self.signals: set[str] = set()
        for index, operation in enumerate(graph.operations):
            before = len(self.builder.operations)
            self.exact[index] = self._lowered(index, operation)
            self._name(before, self.exact[index], graph.origins[index])

    def _name(self, before: int, last: int, origin: str) -> None:
        if last >= before:
            self.builder.name(last, origin)
        for index in range(before, len(self.builder.operations)):
            self.builder.name(index, origin if origin.endswith(TERM) else origin + TERM)

    def _lowered(self, index: int, operation: Operation) -> int:
        builder = self.builder
        match operation:
            case Coefficient(name, value):
                form = self._form(index, signal_of(name))
                leaf = builder.intern(Coefficient(name, form.real(form.nearest(value))))
                self.given[leaf] = form
                return leaf
            case Input(name) | State(name):
                leaf = builder.intern(operation)
                self.given[leaf] = self._form(index, signal_of(name))
                return leaf
            case Constant():
                return builder.intern(operation)
            case Add(a, b):
                return builder.add(*self._addends(a, b))
            case Subtract(a, b):
                return builder.subtract(*self._addends(a, b))
            case Multiply(a, b):
                factor = builder.value(self.exact[a])
                if factor is not None:
                    return self._by_constant(factor, self._near(b))
                return builder.multiply(self.narrow(a), self.narrow(b))
            case Shift(a, exponent):
                return builder.shift(self.own(a), exponent)
            case Reciprocal(a):
                return self._reciprocal(self._divisor(a), max(self.ranges.low[a], _TINY))
            case Divide(a, b):
                return self._quotient(index, a, b)
            case Unary(function, a):
                return self._function(index, function, a)
            case Binary(function, a, b):
                return self._function(index, function, a, b)
            case Table(a, rows):
                return self._row(index, a, rows)
            case Select(flag, a, b):
                return builder.select(self.exact[flag], *self._addends(a, b))
            case _:
                assert is_flag(operation), operation
                return builder.rebuild(operation, self.exact)

    def type(self, index: int) -> Typed:
        """Format and interval of an operation of the new graph."""
        for k in range(len(self.types), index + 1):
            operation = self.builder.operations[k]
            self.types.append(None if is_flag(operation) else self._type(k, operation))
        typed = self.types[index]
        assert typed is not None
        return typed

    def _type(self, index: int, operation: Operation) -> Typed:
        specification = self.specification
        if isinstance(operation, Reciprocal):
            form = self.given[index]
            divisor = self.types[operation.a]
            assert divisor is not None
            interval = reciprocal_interval(divisor, form, specification.rounding, specification.division)
            return form, interval
        if index in self.circuit.known:
            assert isinstance(operation, Bits)
            return operation.form, self.circuit.known[index]
        typed = type_of(operation, self.types, self.given.get(index))  # type: ignore[arg-type]
        if isinstance(operation, Multiply) and self._is_weighted_square(operation):
            form, interval = typed
            return smallest(0, interval.high, form.fraction), Interval(low=0, high=interval.high)
        return typed

    def _is_weighted_square(self, product: Multiply) -> bool:
        """Whether a product is y (w y) with w >= 0, which no rounding of w y makes negative."""
        operations = self.builder.operations
        for y, weighted in ((product.a, product.b), (product.b, product.a)):
            operation = operations[weighted]
            inner = operations[operation.a] if isinstance(operation, Quantise) else operation
            if isinstance(operation, Quantise) and operation.overflow is Overflow.WRAP:
                continue
            if isinstance(inner, Multiply) and y in (inner.a, inner.b):
                weight = self.types[inner.b if y == inner.a else inner.a]
                if weight is not None and weight[1].low >= 0:
                    return True
        return False

    def output(self, index: int) -> int:
        """An output's value, in its own format if it has one."""
        before = len(self.builder.operations)
        own = self.own(index)
        self._name(before, own, self.graph.origins[index])
        return own

    def own(self, index: int) -> int:
        """The value as later operations see it: in its own format if it has one, else exact."""
        exact = self.exact[index]
        if self.builder.value(exact) is not None or is_flag(self.builder.operations[exact]):
            return exact
        signal = signal_of(self.graph.origins[index])
        return self.narrow(index) if signal.own_format else exact

    def narrow(self, index: int) -> int:
        """The value in its format: an operand of a multiplication."""
        exact = self.exact[index]
        if self.builder.value(exact) is not None:
            return exact
        if isinstance(self.graph.operations[index], Reciprocal):
            return exact
        signal = self._signal(index)
        return self._fitted(exact, signal, self._form(index, signal))

    def _near(self, index: int) -> int:
        """An operand of a constant multiplication: exact while it is not much wider than its format."""
        own = self.own(index)
        form = self._form(index, self._signal(index))
        return own if self.type(own)[0].width <= form.width + _GUARD else self.narrow(index)

    def _divisor(self, index: int) -> int:
        """A divisor in its format, which has no sign."""
        signal = self._signal(index)
        form = self._form(index, signal, unsigned=True)
        return self._fitted(self.own(index), signal, form)

    def _addends(self, a: int, b: int) -> tuple[int, int]:
        """Operands of a sum or choice; a constant keeps few bits below the last one of the other."""
        x, y = self.own(a), self.own(b)
        return self._beside(x, y), self._beside(y, x)

    def _beside(self, index: int, other: int) -> int:
        value = self.builder.value(index)
        if value is None or value == 0:
            return index
        constant = significant(value, self._constant_width())
        if self.builder.value(other) is None:
            finest = Fraction(2) ** -(self.type(other)[0].fraction + _GUARD)
            if constant.denominator > finest.denominator:
                constant = round(constant / finest) * finest
        return self.builder.constant(constant)

    def _by_constant(self, factor: Fraction, index: int) -> int:
        factor = significant(factor, self._constant_width())
        return multiplied(self.builder, factor, index, on_multipliers=self.on_multipliers)

    def _quotient(self, index: int, a: int, b: int) -> int:
        """A quotient whose divisor may come near zero goes by the reciprocal, which is watched."""
        divisor = self._divisor(b)
        if self.type(divisor)[1].low <= 0:
            reciprocal = self._reciprocal(divisor, max(abs(self.ranges.low[b]), _TINY))
            return self.builder.multiply(self.narrow(a), reciprocal)
        made = self.builder.intern(Divide(self.narrow(a), divisor))
        self.given.setdefault(made, self._form(index, self._signal(index)))
        return made

    def _reciprocal(self, divisor: int, least: float) -> int:
        """A reciprocal that fits its format for every divisor, or for those seen and half of the least."""
        made = self.builder.intern(Reciprocal(divisor))
        if made not in self.given:
            wanted = self.specification.form("reciprocal")
            form, interval = self.type(divisor)
            if interval.low > 0:
                least = float(form.real(interval.low))
            if isinstance(wanted, Fixed):
                self.given[made] = _unsigned(wanted) if wanted.signed else wanted
            else:
                integer = math.floor(math.log2(1 / least)) + (1 if interval.low > 0 else 2)
                integer += self.specification.room("reciprocal")
                self.given[made] = Fixed(width=wanted, fraction=wanted - integer, signed=False)
        return made

    def _function(self, index: int, function: Function, *arguments: int) -> int:
        """A function of arguments as they are, but of squared ones, which are multiplied."""
        method = self.specification.functions
        form = self._form(index, self._signal(index))
        if method is None:
            method = method_for(form.width)
        near = self._near if function in _OF_POINTS else self.own
        return lowered(self.circuit, function, tuple(map(near, arguments)), form, method)

    def _row(self, index: int, a: int, rows: tuple[Fraction, ...]) -> int:
        """A row in the format of its value; a number beyond the last row gives the last one."""
        form = self._form(index, self._signal(index))
        number = Fixed(width=max(1, (len(rows) - 1).bit_length()), fraction=0, signed=False)
        specification, place = self.specification, self._quantised(self.own(a), number)
        if self.type(place)[0].fraction:
            place = self.builder.intern(
                Quantise(place, number, specification.rounding, specification.overflow)
            )
        rounded_rows = tuple(form.real(form.nearest(row)) for row in rows)
        return self.circuit.row(place, rounded_rows)

    def _constant_width(self) -> int:
        form = self.specification.form("constant")
        return form.width if isinstance(form, Fixed) else form

    def _signal(self, index: int) -> SignalName:
        if isinstance(self.graph.operations[index], Reciprocal):
            return SignalName(name="", signal_class="reciprocal", unsigned=True, own_format=True)
        return signal_of(self.graph.origins[index])

    def _form(self, index: int, signal: SignalName, unsigned: bool = False) -> Fixed:
        if signal.signal_class == "bit":
            return Fixed(width=1, fraction=0, signed=False)
        self.signals.add(signal.name)
        wanted = self.specification.form(signal.signal_class, signal.name)
        signed = not (unsigned or signal.unsigned or self.ranges.never_negative(index))
        if isinstance(wanted, Fixed):
            return wanted if wanted.signed == signed or signed else _unsigned(wanted)
        greatest = max(abs(self.ranges.low[index]), abs(self.ranges.high[index]))
        greatest *= margin(self.ranges, index, signal.signal_class)
        operation = self.graph.operations[index]
        if isinstance(operation, Table):
            # Tracks that are long enough reach every row.
            greatest = float(max(map(abs, operation.rows)))
        if isinstance(operation, Unary | Binary):
            greatest = min(greatest, REACH.get(operation.function, greatest))
        integer = math.frexp(greatest)[1] if greatest else 0
        integer += self.specification.room(signal.signal_class, signal.name)
        return Fixed(width=wanted, fraction=wanted - integer - signed, signed=signed)

    def _fitted(self, index: int, signal: SignalName, form: Fixed) -> int:
        """The value in the format; itself where it is always inside and needs no rounding.

        Where the exact value has fewer fraction bits, a chosen format reaches further up instead, and a
        whole format that the design gives keeps its limits.
        """
        exact, interval = self.type(index)
        whole = isinstance(self.specification.form(signal.signal_class, signal.name), Fixed)
        if interval.low >= 0 and form.signed and not whole:
            form = _unsigned(form)
        if exact.fraction < form.fraction:
            spare = form.fraction - exact.fraction
            width = max(1, form.width - spare) if whole else form.width
            form = Fixed(width=width, fraction=exact.fraction, signed=form.signed)
        if exact.fraction == form.fraction and form.lowest <= interval.low and interval.high <= form.highest:
            return index
        return self._quantised(index, form)

    def _quantised(self, index: int, form: Fixed) -> int:
        """Rounded and clamped; choices are made after it, so that constants cost nothing."""
        operation = self.builder.operations[index]
        if isinstance(operation, Constant):
            return self.builder.constant(form.real(form.nearest(operation.value)))
        if isinstance(operation, Select):
            a, b = self._quantised(operation.a, form), self._quantised(operation.b, form)
            return self.builder.select(operation.flag, a, b)
        exact, interval = self.type(index)
        if (
            exact.fraction <= form.fraction
            and form.real(form.lowest) <= exact.real(interval.low)
            and exact.real(interval.high) <= form.real(form.highest)
        ):
            return index
        return self.builder.intern(
            Quantise(index, form, self.specification.rounding, self.specification.overflow)
        )

    def state(self, name: str, root: int) -> int:
        """The next value of a state, in exactly the format in which it is kept."""
        before = len(self.builder.operations)
        leaf = self.builder.intern(State(name))
        form = self.given[leaf]
        self._check_constants(name, self.exact[root], form)
        index = self._quantised(self.exact[root], form)
        if self.type(index)[0] != form:
            index = self.builder.intern(
                Quantise(index, form, self.specification.rounding, self.specification.overflow)
            )
        self._name(before, index, f"posterior: {name}")
        return index

    def _check_constants(self, name: str, index: int, form: Fixed) -> None:
        operation = self.builder.operations[index]
        if isinstance(operation, Select):
            self._check_constants(name, operation.a, form)
            self._check_constants(name, operation.b, form)
        value = self.builder.value(index)
        if value is not None and not form.real(form.lowest) <= value <= form.real(form.highest):
            limit = form.real(form.highest if value > 0 else form.lowest)
            signal = signal_of(name)
            asked = self.specification.form(signal.signal_class, signal.name)
            key = self.specification.key(signal.signal_class, signal.name)
            remedy = (
                "fewer fraction bits" if isinstance(asked, Fixed) else "a format with fewer fraction bits"
            )
            raise FormatError(
                f"{key}: {name} starts at {float(value):.6g} but {form} ends at {float(limit):.6g}: "
                f"give [numerics.signals] {name} {remedy}, or a larger [numerics] scale",
                table=key[1:].partition("] ")[0],
                key=key.partition("] ")[2],
            )

    def finished(
        self, states: list[tuple[str, int]], outputs: list[tuple[str, int]], scales: dict[str, float]
    ) -> TypedGraph:
        """The typed graph with its violations gathered into the flag ``saturated``."""
        found = self._violations(states, outputs)
        saturated = sticky(self.builder, ((v.outside, v.starting, v.running) for v in found))
        states, outputs = [*states, (NAME, saturated)], [*outputs, (NAME, saturated)]
        kept = sorted(reachable(self.builder.operations, [index for _, index in (*states, *outputs)]))
        place = {old: new for new, old in enumerate(kept)}
        self.type(next(k for k in reversed(kept) if not is_flag(self.builder.operations[k])))
        types = [None if is_flag(self.builder.operations[k]) else self.type(k) for k in kept]
        specification = self.specification
        return TypedGraph(
            graph=self.builder.graph(states, outputs),
            formats=tuple(t and t[0] for t in types),
            intervals=tuple(t and t[1] for t in types),
            division=specification.division,
            division_rounding=specification.rounding,
            violations=tuple(
                Violation(
                    quantise=place[v.quantise],
                    outside=place[v.outside],
                    starting=v.starting,
                    running=v.running,
                )
                for v in found
            ),
            scales=scales,
        )

    def _violations(self, states: list[tuple[str, int]], outputs: list[tuple[str, int]]) -> list[Violation]:
        builder = self.builder
        view = Graph(tuple(builder.operations), tuple(builder.origins), tuple(states), tuple(outputs))
        starting, running = cone(view, initialise=True), cone(view, initialise=False)
        found = []
        needed = starting | running
        for index in sorted(needed):
            outside = self._outside(index, view.operations[index])
            if outside is not None:
                builder.name(outside, f"outside: {builder.origins[index]}")
                outside = self._where_chosen(view, needed, index, outside)
                found.append(
                    Violation(
                        quantise=index, outside=outside, starting=index in starting, running=index in running
                    )
                )
        return found

    def _where_chosen(self, view: Graph, needed: set[int], index: int, outside: int) -> int:
        """The flag where the value is taken: what a missed measurement would be is of no account."""
        while index not in view.roots:
            users = [user for user in view.users[index] if user in needed]
            selects = [op for user in users if isinstance(op := view.operations[user], Select)]
            choices = {(op.flag, op.a == index) for op in selects}
            if len(choices) != 1 or len(selects) < len(users):
                break
            ((flag, holds),) = choices
            if view.operations[flag] != Flag("initialise"):
                outside = self.builder.both(outside, flag if holds else self.builder.opposite(flag))
            if len(users) > 1:
                break
            (index,) = users
        return outside

    def _outside(self, index: int, operation: Operation) -> int | None:
        """The flag that a value does not fit its format, None where it always does."""
        if isinstance(operation, Quantise) and self._can_leave(operation):
            return self.builder.intern(Outside(operation.a, operation.form, operation.rounding))
        if isinstance(operation, Reciprocal):
            return self._below_least(operation.a, self.given[index])
        return None

    def _below_least(self, divisor: int, form: Fixed) -> int | None:
        """The flag that a divisor is so small that its reciprocal leaves the format."""
        divisor_form, interval = self.type(divisor)
        least = least_divisor(divisor_form, form, self.specification.division)
        if interval.low >= least:
            return None
        shortfall = self.builder.intern(
            Subtract(divisor, self.builder.intern(Constant(divisor_form.real(least))))
        )
        exact, _ = self.type(shortfall)
        never_negative = Fixed(width=exact.width, fraction=exact.fraction, signed=False)
        return self.builder.intern(Outside(shortfall, never_negative, self.specification.rounding))

    def _can_leave(self, operation: Quantise) -> bool:
        exact, interval = self.type(operation.a)
        form, dropped = operation.form, exact.fraction - operation.form.fraction
        low, high = (rounded(raw, dropped, operation.rounding) for raw in (interval.low, interval.high))
        return bool(low < form.lowest or high > form.highest)


def significant(value: Fraction, bits: int) -> Fraction:
    """The value rounded to so many significant bits."""
    if value == 0:
        return value
    exponent = bits - (abs(value.numerator).bit_length() - value.denominator.bit_length()) - 1
    return round(value * Fraction(2) ** exponent) * Fraction(2) ** -exponent


def _unsigned(form: Fixed) -> Fixed:
    return Fixed(width=form.width - 1 if form.width > 1 else 1, fraction=form.fraction, signed=False)
