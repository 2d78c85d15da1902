"""What fits the units of a shape, and what is said where something does not."""

from collections.abc import Sequence
from dataclasses import dataclass

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.errors import DesignError, FormatError
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.programmable.control import DROPPED_OF_QUOTIENT, MOST_ADDED, MOST_DROPPED, quotient_bits
from kalmanhdl.programmable.operations import Stage
from kalmanhdl.shape import Shape


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The numbers of a graph beside the widths of a shape. Operations are called by their origins."""

    typed: TypedGraph
    shape: Shape

    def _name(self, index: int) -> str:
        return self.typed.graph.origins[index]

    def fraction(self, index: int) -> int:
        """The fraction bits of a number as the graph has it."""
        form = self.typed.formats[index]
        assert form is not None
        return form.fraction

    def bits(self, index: int, fraction: int) -> int:
        """Bits of a number, signed, at a fraction no less than its own."""
        interval = self.typed.intervals[index]
        assert interval is not None
        lift = max(fraction - self.fraction(index), 0)
        return _signed_bits(interval.low << lift, interval.high << lift)

    def check_word(self, index: int, fraction: int) -> None:
        """Raise FormatError for a number that is wider than words."""
        self.check_width(index, fraction, self.shape.word_width, "words", "word_width")

    def check_width(self, index: int, fraction: int, room: int, what: str, key: str) -> None:
        """Raise FormatError for a number that has more bits than ``what`` has room for."""
        bits = self.bits(index, fraction)
        if bits > room:
            raise FormatError(
                f"{self._name(index)} takes {bits} bits, and {what} have {room}: build hardware with "
                f"[architecture] {key} {bits - room} bits more, or give the model narrower formats"
            )

    def checked(self, index: int, stage: Stage) -> Stage:
        """A stage that the hardware has, behind a number of the graph. Raises FormatError."""
        # The rounded value must be a word before it is brought into the format.
        self.check_word(index, self.fraction(index) - min(stage.dropped, 0))
        return self.staged(index, stage)

    def staged(self, index: int, stage: Stage) -> Stage:
        """A stage that the hardware has. Raises FormatError."""
        if not -MOST_ADDED <= stage.dropped <= MOST_DROPPED:
            way, most = ("drops", MOST_DROPPED) if stage.dropped > 0 else ("appends", MOST_ADDED)
            raise FormatError(
                f"{self._name(index)}: rounding {way} {abs(stage.dropped)} bits, and the stage "
                f"behind a unit {most} at most: give formats whose binary points are nearer to each other"
            )
        most = self.shape.word_width - (not stage.signed)
        if stage.width > most:
            raise FormatError(
                f"{self._name(index)} has a format of {stage.width} bits, and words have room "
                f"for {most}: build hardware with [architecture] word_width {stage.width - most} bits more"
            )
        return stage

    def check_division(self) -> None:
        """Raise DesignError for reciprocals that are computed in another way than the hardware's."""
        bits = self.shape.reciprocal_table
        match self.typed.division:
            case LongDivision():
                same, own = bits is None, "exact"
            case TableNewton(index_bits=index_bits, iterations=iterations):
                same, own = (bits, 0) == (index_bits, iterations), f"by a table of 2^{index_bits}"
                own += f" and {iterations} Newton steps" if iterations else ""
        if not same:
            built = "exact ones" if bits is None else f"a table of 2^{bits}"
            remedy = '"radix2"' if bits is None else f"{{ table = {bits} }}"
            raise DesignError(
                f"reciprocals are {own}, and the hardware has {built}: use [numerics] division = {remedy}, "
                "or build hardware with another [architecture] reciprocal_table",
                table="numerics",
                key="division",
            )

    def reciprocal(self, index: int, divisor: int) -> tuple[int | None, int]:
        """The power of two that is divided by a divisor, None by a table, and how many bits are then dropped.

        Raises FormatError.
        """
        fractions, shape = self.fraction(divisor) + self.fraction(index), self.shape
        self.check_width(divisor, self.fraction(divisor), shape.number_width, "divisors", "operand_width")
        if shape.reciprocal_table is not None:
            method = TableNewton(index_bits=shape.reciprocal_table, iterations=0)
            exponent, dropped = None, method.table_fraction + shape.number_width - 1 - fractions
            room = shape.word_width - 1 - max(dropped, 0)
        else:
            exponent, dropped, room = fractions + 1, DROPPED_OF_QUOTIENT, quotient_bits(shape) - 1
            if not 0 <= exponent <= room:
                forms = self.typed.formats[divisor], self.typed.formats[index]
                raise FormatError(
                    f"{self._name(index)}: the reciprocal of {forms[0]} in {forms[1]} divides 2^{exponent}, "
                    f"and the reciprocal unit 2^0 to 2^{room}: build hardware with another [architecture] "
                    "word_width, or give formats with fewer fraction bits"
                )
        # Of a divisor 0 the reciprocal is the limit of its format, which the word must reach.
        self.check_width(index, self.fraction(index), room, "reciprocals", "word_width")
        return exponent, dropped

    def port(self, name: str, ports: Sequence[str]) -> None:
        """Raise DesignError for what comes in or is put out, and has no port."""
        if name not in ports:
            raise DesignError(
                f"{name} has no port, and the hardware has {', '.join(ports)}: build hardware with more "
                "[architecture] states, measurements or controls"
            )

    def check_port(self, index: int, name: str, ports: Sequence[str]) -> None:
        """Raise DesignError for a number without a port, FormatError for one wider than ports."""
        self.port(name, ports)
        room = self.shape.number_width
        self.check_width(
            index, self.fraction(index), room, f"ports, such as that of {name},", "operand_width"
        )

    def unknown(self, index: int) -> DesignError:
        """What to raise for an operation that no unit has."""
        operation = type(self.typed.graph.operations[index]).__name__
        return DesignError(
            f"{self._name(index)} takes the operation {operation}, which a programmable datapath has not: "
            'it adds, multiplies, selects and takes reciprocals: use control = "fixed"'
        )


def _signed_bits(low: int, high: int) -> int:
    """Bits of the signed integers from ``low`` to ``high``."""
    return max((raw if raw >= 0 else ~raw).bit_length() for raw in (low, high)) + 1
