"""Reciprocals from a table and Newton steps, in hardware."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.division import TableNewton, reciprocal, reciprocal_table
from kalmanhdl.arithmetic.division_structure import NewtonStep, Operand, table_structure
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.arithmetic.product_structure import block_addends, logic_addends, tree_levels
from kalmanhdl.rtl.adder_tree import Term, summed
from kalmanhdl.rtl.leading_one import leading_zeros, shifted_left
from kalmanhdl.rtl.multiplier import block_products, logic_products
from kalmanhdl.rtl.quantiser import aligned, quantised
from kalmanhdl.rtl.shapes import fitted, shape_of
from kalmanhdl.rtl.stages import Stages, named
from kalmanhdl.rtl.table import looked_up

# In levels of adders.
_TABLE_WEIGHT = 1.5
_SELECTION_WEIGHT = 0.5


class TableNewtonReciprocal(wiring.Component):
    """The reciprocal by a table: ``arithmetic.division.reciprocal``, bit for bit.

    Ports: ``divisor``, ``quotient``, and ``outside``: the reciprocal does not fit. The result stands
    ``registers`` clocks after its operand. Divisors outside their interval give any result.
    """

    def __init__(
        self,
        divisor: Operand,
        form: Fixed,
        rounding: Rounding,
        method: TableNewton,
        registers: int = 0,
        on_block: bool = True,
    ) -> None:
        self.divisor_operand, self.form, self.rounding = divisor, form, rounding
        self.method, self.registers = method, registers
        self.structure = table_structure(divisor, form, rounding, method)
        self._fractions = method.fractions(form)
        self._products = block_products if on_block else logic_products
        self._addends = block_addends if on_block else logic_addends
        super().__init__(
            {"divisor": In(shape_of(divisor.form)), "quotient": Out(shape_of(form)), "outside": Out(1)}
        )

    def compute(self, divisor: int) -> tuple[int, bool]:
        """The raw reciprocal, and whether it did not fit."""
        return reciprocal(divisor, self.divisor_operand.form.fraction, self.form, self.rounding, self.method)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        stages = Stages(m, self._weights(), self.registers)
        state = stages.before(1, self._normalised(m))
        state = self._looked_up(m, state)
        step = 2
        for newton in self.structure.steps:
            step, state = self._refined(m, stages, step, newton, state)
        state = self._denormalised(m, stages.before(step, state))
        quotient, out = self._clamped(stages.before(step + 1, state))
        result = stages.before(step + 2, {"quotient": quotient, "outside": out})
        m.d.comb += [self.quotient.eq(result["quotient"]), self.outside.eq(result["outside"])]
        return m

    def _weights(self) -> tuple[float, ...]:
        selection = _SELECTION_WEIGHT * (self.structure.positions - 1).bit_length()
        weights = [2 * selection, _TABLE_WEIGHT]
        for step in self.structure.steps:
            for count in self._addend_counts(step):
                weights += [_SELECTION_WEIGHT, *(1.0,) * tree_levels(count)]
        rounding = 0.0 if self.rounding in (Rounding.FLOOR, Rounding.TOWARD_ZERO) else 1.0
        return (*weights, selection + rounding, _SELECTION_WEIGHT * self.structure.above)

    def _addend_counts(self, newton: NewtonStep) -> tuple[int, int]:
        negated = newton is self.structure.steps[0]
        value = newton.fraction + 1
        return (
            self._addends(self.structure.longest, False, value + negated, negated),
            self._addends(value, False, newton.change_bits, True) + 1,
        )

    def _normalised(self, m: Module) -> dict[str, Value]:
        """The divisor shifted until its leading one stands at the top, and by how much."""
        longest, positions = self.structure.longest, self.structure.positions
        divisor = fitted(self.divisor, longest, False)
        amount = named(m, "amount", leading_zeros(divisor[longest - positions + 1 :]))
        shifted = shifted_left(m, "shifted", divisor, amount, 0)
        return {
            "normalised": named(m, "normalised", shifted),
            "amount": amount,
            "small": named(m, "small", divisor >> (self.structure.shortest - 1) == 0),
        }

    def _looked_up(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """The table's approximation; its negative as well where Newton steps follow."""
        count, width = self.method.index_bits, self._fractions[0] + 1
        below_leading = state["normalised"][:-1]
        missing = count - len(below_leading)
        index = Cat(Const(0, missing), below_leading) if missing > 0 else below_leading[-missing:]
        entries = reciprocal_table(count)
        state["value"] = looked_up(m, "entry", index, entries, width)
        if self.structure.steps:
            negatives = [-entry & ((1 << width) - 1) for entry in entries]
            entry = looked_up(m, "negative", index, negatives, width)
            state["negative"] = Cat(entry, Const(1, 1)).as_signed()
        return state

    def _refined(
        self, m: Module, stages: Stages, first: int, newton: NewtonStep, state: dict[str, Value]
    ) -> tuple[int, dict[str, Value]]:
        """One Newton step: the value times 2 minus the divisor times the value."""
        state = stages.before(first, state)
        negative = state.pop("negative", None)
        by = state["value"] if negative is None else negative
        terms = self._products(m, f"product_{first}", state["normalised"], by)
        total, state = summed(m, stages, first + 1, terms, newton.difference_bits, state)
        step = first + 1 + tree_levels(len(terms))
        state = stages.before(step, state | {"total": total})
        total = state.pop("total")
        difference = fitted(total if negative is not None else -total, newton.difference_bits, True)
        change = (
            difference >> newton.dropped if newton.dropped > 0 else difference.shift_left(-newton.dropped)
        )
        change = named(m, f"change_{first}", fitted(change, newton.change_bits, True))
        terms = [
            *self._products(m, f"product_{step}", state["value"], change),
            Term(newton.kept, state["value"]),
        ]
        width = newton.fraction + newton.kept + 2
        total, state = summed(m, stages, step + 1, terms, width, state)
        low = newton.fraction + newton.kept - newton.target
        state["value"] = fitted(total, width, False)[low : low + newton.target + 1]
        return step + 1 + tree_levels(len(terms)), state

    def _denormalised(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """The approximation at its place among the positions."""
        most = self.structure.positions - 1
        moved = shifted_left(m, "moved", state["value"], state["amount"], most)
        fraction = self._fractions[-1] + self.structure.longest - self.divisor_operand.form.fraction
        result = aligned(moved, fraction, self.form, self.rounding)
        return {"rounded": named(m, "rounded", result), "small": state["small"]}

    def _clamped(self, state: dict[str, Value]) -> tuple[Value, Value]:
        form = self.form
        bounds = (None, None) if self.structure.above else (0, form.highest)
        quotient, out = quantised(
            state["rounded"], form.fraction, form, self.rounding, Overflow.SATURATE, *bounds
        )
        if self.divisor_operand.low >> (self.structure.shortest - 1):
            return quotient, out
        return fitted(Mux(state["small"], form.highest, quotient), form.width, form.signed), out | state[
            "small"
        ]
