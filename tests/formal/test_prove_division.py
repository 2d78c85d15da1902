"""Dividers, reciprocals and roots are the defined ones, proven for every operand.

Every dividend is a quotient times its divisor and a remainder below it: with these three free, the solver
need not divide.
"""

import pytest
from amaranth.hdl import Assert, Assume, Const, Module, Mux, Signal, signed
from amaranth.lib.wiring import Component, In
from harness import opened, proof

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.division_structure import ONE, Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.divider import IterativeDivider, LongDivider
from kalmanhdl.rtl.long_division import LongDivisionCore
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal
from kalmanhdl.rtl.reciprocal_table import ReciprocalTable
from kalmanhdl.rtl.square_root import IterativeSquareRoot
from kalmanhdl.rtl.table import looked_up


def everything(width: int, fraction: int, is_signed: bool) -> Operand:
    form = Fixed(width=width, fraction=fraction, signed=is_signed)
    return Operand(form=form, low=form.lowest, high=form.highest)


def rounded_up(quotient, remainder, divisor, rounding: Rounding):
    """Whether quotient + remainder / divisor rounds to the quotient above."""
    match rounding:
        case Rounding.FLOOR:
            return Const(0)
        case Rounding.HALF_UP:
            return 2 * remainder >= divisor
        case Rounding.HALF_EVEN:
            return (2 * remainder > divisor) | ((2 * remainder == divisor) & quotient[0])
        case Rounding.TOWARD_ZERO:
            return (quotient < 0) & (remainder != 0)


def wanted(core: LongDivisionCore, quotient, remainder, divisor, negative):
    """The result in the format, and whether the rounded quotient did not fit."""
    form = core.form
    exact = quotient + rounded_up(quotient, remainder, divisor, core.rounding)
    zero = divisor == 0
    above, below = exact > form.highest, exact < form.lowest
    limited = Mux(above, form.highest, Mux(below, form.lowest, exact))
    return Mux(zero, Mux(negative, form.lowest, form.highest), limited), zero | above | below


class Quotients(Component):
    """Dividers of one pair of operands, each against its definition; ``fault`` changes the divisor of one."""

    def __init__(self, cores: list[LongDivider], fault: int = 0) -> None:
        self.cores, self.fault = cores, fault
        first = cores[0]
        a, b = first.dividend_operand.form, first.divisor_operand.form
        scale = b.fraction - a.fraction + first.form.fraction
        self.up, self.down = max(scale, 0), max(-scale, 0)
        self.bits = a.width + self.up + 1
        ports = {"quotient": signed(self.bits), "remainder": b.width + self.down, "divisor": b.width}
        super().__init__({name: In(shape) for name, shape in ports.items()})

    def elaborate(self, platform):
        m = Module()
        divisor = self.divisor.shift_left(self.down)
        scaled = Signal(signed(self.bits + len(divisor) + 1))
        dividend = Signal(signed(len(scaled)))
        operand = self.cores[0].dividend_operand
        m.d.comb += [
            scaled.eq(self.quotient * divisor + self.remainder),
            dividend.eq(scaled >> self.up),
            Assume(scaled[: self.up] == 0),
            Assume((dividend >= operand.low) & (dividend <= operand.high)),
            # Over zero the remainder alone is the dividend, but for its sign.
            Assume((self.remainder < divisor) | (divisor == 0)),
        ]
        for index, core in enumerate(self.cores):
            m.submodules[f"core_{index}"] = core
            m.d.comb += [core.dividend.eq(dividend), core.divisor.eq(self.divisor ^ self.fault)]
            value, out = wanted(core, self.quotient, self.remainder, divisor, dividend < 0)
            m.d.comb += [Assert(core.quotient == value), Assert(core.outside == out)]
        return m


def dividers(width: int, rounding: Rounding, radices=(2, 4), is_signed: bool = True) -> list[LongDivider]:
    dividend, divisor = everything(width, 2, is_signed), everything(width, 3, False)
    form = Fixed(width=width, fraction=width // 2, signed=is_signed)
    return [LongDivider(dividend, divisor, form, rounding, radix) for radix in radices]


@pytest.mark.parametrize("rounding", Rounding)
def test_every_quotient_of_five_bits_is_the_defined_one(rounding):
    found = proof(Quotients(dividers(5, rounding)))
    assert found.bounded, found.broken


@pytest.mark.slow
@pytest.mark.parametrize("radix", [2, 4])
@pytest.mark.parametrize("rounding", Rounding)
def test_every_quotient_of_eight_bits_is_the_defined_one(rounding, radix):
    found = proof(Quotients(dividers(8, rounding, (radix,))))
    assert found.bounded, found.broken


def test_a_fault_in_a_divider_is_seen():
    assert "Assert failed" in proof(Quotients(dividers(5, Rounding.FLOOR), fault=1)).broken


class Reciprocals(Component):
    """Reciprocals of short divisors against a table of the definition; ``fault`` turns one bit of it."""

    def __init__(self, cores: list, fault: int = 0) -> None:
        self.cores, self.fault = cores, fault
        super().__init__({"divisor": In(cores[0].divisor.shape())})

    def elaborate(self, platform):
        m = Module()
        for index, core in enumerate(self.cores):
            m.submodules[f"core_{index}"] = core
            width = core.form.width
            one = (1,) if isinstance(core, LongDivider) else ()
            results = [core.compute(*one, divisor) for divisor in range(1 << len(self.divisor))]
            entries = [value & ((1 << width) - 1) | out << width for value, out in results]
            entries[-1] ^= self.fault
            entry = looked_up(m, f"defined_{index}", self.divisor, entries, width + 1)
            m.d.comb += [
                core.divisor.eq(self.divisor),
                Assert(core.quotient.as_unsigned() == entry[:width]),
                Assert(core.outside == entry[width]),
            ]
        return m


def reciprocals(rounding: Rounding, form: Fixed) -> list:
    divisor = everything(8, 4, False)
    methods = [TableNewton(index_bits=bits, iterations=n) for bits, n in ((3, 0), (3, 1), (4, 2))]
    cores = [LongDivider(ONE, divisor, form, rounding, radix) for radix in (2, 4)]
    cores += [
        TableNewtonReciprocal(divisor, form, rounding, method, 0, on_block)
        for method in methods
        for on_block in (True, False)
    ]
    return [*cores, ReciprocalTable(divisor, form, rounding, TableNewton(index_bits=7, iterations=0))]


@pytest.mark.parametrize("rounding", Rounding)
def test_every_reciprocal_of_eight_bits_is_the_defined_one(rounding):
    for form in (Fixed(width=9, fraction=5), Fixed(width=14, fraction=12, signed=False)):
        found = proof(Reciprocals(reciprocals(rounding, form)))
        assert found.bounded, found.broken


def test_a_fault_in_a_reciprocal_is_seen():
    cores = reciprocals(Rounding.FLOOR, Fixed(width=9, fraction=5))[-1:]
    assert "Assert failed" in proof(Reciprocals(cores, fault=1)).broken


class Timed(Component):
    """A unit that takes a start at any time, also before it is done, with what it was given last.

    ``late`` expects the result so many clocks too late.
    """

    def __init__(self, core: IterativeDivider | IterativeSquareRoot, late: int = 0) -> None:
        self.core, self.expected = core, core.latency + late
        self.names = [name for name in ("dividend", "divisor", "radicand") if hasattr(core, name)]
        ports = {name: getattr(core, name).shape() for name in self.names}
        free = {"quotient": signed(16), "remainder": 8} if "divisor" in ports else {}
        super().__init__({name: In(shape) for name, shape in {"start": 1, **ports, **free}.items()})

    def elaborate(self, platform):
        m = Module()
        m.submodules.core, inner = opened(self.core)
        since = Signal(range(self.expected + 2), init=self.expected + 1)
        m.d.sync += since.eq(Mux(self.start, 1, since + (since != self.expected + 1)))
        held = {}
        for name in self.names:
            held[name] = Signal(getattr(self, name).shape(), name=f"given_{name}")
            m.d.comb += getattr(self.core, name).eq(getattr(self, name))
            with m.If(self.start):
                m.d.sync += held[name].eq(getattr(self, name))
        done, clocks = self.core.done, self.core.iteration.clocks
        m.d.comb += [
            self.core.start.eq(self.start),
            Assert(done == (since == self.expected)),
            Assert(Mux(since <= clocks, inner["left"] == clocks + 1 - since, inner["left"] == 0)),
        ]
        right = self._quotient(**held) if "divisor" in held else self._root(**held)
        m.d.comb += Assert(~done | right)
        return m

    def _root(self, radicand):
        root, scaled = self.core.root, radicand.shift_left(2 * self.core.extra)
        return (root * root <= scaled) & ((root + 1) * (root + 1) > scaled)

    def _quotient(self, dividend, divisor):
        """Right if what is assumed of quotient and remainder holds; without a division by zero."""
        core = self.core
        up = core.divisor_operand.form.fraction - core.dividend_operand.form.fraction + core.form.fraction
        scaled = self.quotient * divisor + self.remainder
        meant = (scaled == dividend.shift_left(up)) & (self.remainder < divisor)
        value, out = wanted(core, self.quotient, self.remainder, divisor, dividend < 0)
        return ~meant | ((core.quotient == value) & (core.outside == out))


@pytest.mark.parametrize(("radix", "rows"), [(2, 1), (2, 2), (4, 1)])
def test_an_iterative_divider_gives_the_quotient_of_its_last_start_in_time(radix, rows):
    dividend, divisor = everything(4, 1, True), everything(4, 1, False)
    core = IterativeDivider(dividend, divisor, Fixed(width=5, fraction=2), Rounding.HALF_UP, radix, rows)
    found = proof(Timed(core), core.latency + 2, induction=True)
    assert (found.bounded, found.inductive) == (True, True), found.broken


@pytest.mark.parametrize(("width", "extra", "rows"), [(6, 0, 1), (5, 1, 2)])
def test_an_iterative_root_is_that_of_its_last_start_in_time(width, extra, rows):
    core = IterativeSquareRoot(width, extra, rows)
    found = proof(Timed(core), core.latency + 2, induction=True)
    assert (found.bounded, found.inductive) == (True, True), found.broken


def test_a_result_that_comes_too_early_is_seen():
    assert "Assert failed" in proof(Timed(IterativeSquareRoot(4), late=1), 8).broken
