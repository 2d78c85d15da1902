"""An operator on which several operations take turns: registers for its operands, then its core."""

from collections.abc import Callable
from functools import cached_property

from amaranth.hdl import Cat, Const, Module, Signal, Value
from amaranth.lib.wiring import Component, In, Member, Out

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.product_structure import LogicProduct, product_pieces
from kalmanhdl.graph.operations import Add
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.float_operators import core as float_core
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.multiply_add import MultiplyAdd
from kalmanhdl.rtl.operators import division, iterative_division
from kalmanhdl.rtl.serial_multiplier import SerialMultiplier
from kalmanhdl.rtl.shapes import fitted, shape_of
from kalmanhdl.rtl.stages import delayed
from kalmanhdl.schedule.accumulator import Accumulator, accumulator
from kalmanhdl.schedule.operator import MultiplyAddRegisters, multiply_add_registers
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.sharing import Core, core
from kalmanhdl.schedule.storage import Port, ports


class SharedUnit(Component):
    """Ports ``operand_<k>``, ``result`` and, for sums, ``subtract``: the second operand is taken away.

    An iterative one has ``start``, high in the clocks in which operands are to be taken. One that sums
    products has ``first``, ``negative``, ``place`` and ``mode``, in the clocks that ``MultiplyAdd`` says, and
    ``outside``.

    The result stands as many clocks after the operands as the operations on it have registers. All numbers
    are raw integers.
    """

    def __init__(self, plan: Plan, number: int) -> None:
        unit = plan.units[number]
        self._plan, self.unit = plan, unit
        self.core: Core = core(plan.typed, unit.kind, plan.sharing.operations[unit.kind])
        self.choices: tuple[Port, ...] = ports(plan, unit)
        self._operations = plan.typed.graph.operations
        # Those before the last of them stand among the choices; a kept result has one of its own.
        self._registers = plan.registers[unit.operations[0]] - unit.steps - self.core.kept
        operands = {f"operand_{k}": In(shape_of(one.form)) for k, one in enumerate(self.core.operands)}
        sign = {"subtract": In(1)} if unit.kind in ("add", "subtract") else {}
        sign |= {"start": In(1)} if unit.busy > 1 else {}
        sign |= self._of_sums() if unit.kind == "multiply_add" else {}
        super().__init__({**operands, **sign, "result": Out(shape_of(self.core.form))})

    def _of_sums(self) -> dict[str, Member]:
        places, modes = range(self.sums.lifts + 1), range(len(self.sums.modes))
        return {
            "first": In(1),
            "negative": In(1),
            "place": In(places),
            "mode": In(modes),
            "outside": Out(1),
        }

    @cached_property
    def sums(self) -> Accumulator:
        """How products are placed and sums quantised, of a unit that sums products."""
        assert isinstance(self._plan.typed, TypedGraph)
        return accumulator(self._plan.typed, self.unit.operations)

    @property
    def _on_block(self) -> bool:
        """Whether it multiplies on multiplier blocks."""
        return bool(self._plan.on_multiplier_block & frozenset(self.unit.operations))

    @property
    def _logic(self) -> LogicProduct | None:
        """What its products are built of where they are not on multiplier blocks."""
        typed = self._plan.typed
        return None if self._on_block or not isinstance(typed, TypedGraph) else typed.logic_product

    @property
    def held(self) -> MultiplyAddRegisters:
        """Where a unit that sums products holds registers."""
        a, b = (one.form for one in self.core.operands)
        sums = self._plan.sharing.pairs[self.unit.operations[0]]
        pieces = product_pieces(a.width, a.signed, b.width, b.signed, self._logic)
        return multiply_add_registers(self._registers - sums, pieces)

    @property
    def added_after(self) -> int:
        """The cycles from choosing the operands of a product to adding it."""
        return self.unit.steps + self.held.apart + self.held.inside

    @property
    def kind(self) -> str:
        """The word for it."""
        return self.unit.kind

    @property
    def form(self) -> Fixed:
        """The format of its raw results."""
        return self.core.form

    @property
    def turns(self) -> int:
        """The most places that a file before it keeps of one value."""
        return max((file.turns for port in self.choices for file in port.files), default=1)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        taken = []
        for k in range(len(self.core.operands)):
            given = getattr(self, f"operand_{k}")
            register = Signal(given.shape(), name=f"taken_{k}", reset_less=True)
            m.d.sync += register.eq(given)
            taken.append(register)
        build: Callable[[Module, list[Signal]], None] = {
            "multiply": self._multiplies,
            "multiply_add": self._sums_products,
            "add": self._adds,
            "subtract": self._adds,
        }.get(self.unit.kind, self._divides)
        if isinstance(self._plan.typed, FloatGraph):
            build = self._computes
        build(m, taken)
        return m

    def _computes(self, m: Module, taken: list[Signal]) -> None:
        """In floating point; a difference is a sum with a number of the other sign."""
        sums = [k for k in self.unit.operations if isinstance(self._operations[k], Add)]
        m.submodules.core = inner = float_core(self._plan, (sums or self.unit.operations)[0], self._registers)
        # Far too many ports choose it for the stage in which it is rounded.
        kept = Signal.like(self.result, name="kept", reset_less=True)
        m.d.sync += kept.eq(inner.result)
        m.d.comb += self.result.eq(kept)
        if len(taken) == 1:
            # Of a reciprocal the only operand is the divisor.
            m.d.comb += inner.b.eq(taken[0])
            return
        sign = self._subtracts(m) ^ bool(not sums and self.unit.kind in ("add", "subtract"))
        b = taken[1]
        m.d.comb += [inner.a.eq(taken[0]), inner.b.eq(Cat(b[:-1], b[-1] ^ sign))]

    def _subtracts(self, m: Module) -> Value:
        """Whether the operation that was taken is a difference."""
        if "subtract" not in self.signature.members:
            return Const(0, 1)
        subtract = Signal(name="taken_subtract", reset_less=True)
        m.d.sync += subtract.eq(self.subtract)
        return subtract

    def _multiplies(self, m: Module, taken: list[Signal]) -> None:
        typed = self._plan.typed
        assert isinstance(typed, TypedGraph)
        a, b = (shape_of(one.form) for one in self.core.operands)
        if self.unit.busy > 1:
            m.submodules.core = serial = SerialMultiplier(a, b)
            m.d.comb += [serial.a.eq(taken[0]), serial.b.eq(taken[1]), self.result.eq(serial.product)]
            m.d.sync += serial.start.eq(self.start)
            return
        m.submodules.core = inner = Multiplier(a, b, self._registers, self._on_block, typed.logic_product)
        m.d.comb += [inner.a.eq(taken[0]), inner.b.eq(taken[1]), self.result.eq(inner.product)]

    def _sums_products(self, m: Module, taken: list[Signal]) -> None:
        a, b = (one.shape() for one in taken)
        m.submodules.core = inner = MultiplyAdd(a, b, self.sums, self.form, self.held, self._logic)
        m.d.comb += [inner.a.eq(taken[0]), inner.b.eq(taken[1])]
        m.d.comb += [
            getattr(inner, port).eq(getattr(self, port)) for port in ("first", "negative", "place", "mode")
        ]
        m.d.comb += [self.result.eq(inner.result), self.outside.eq(inner.outside)]

    def _adds(self, m: Module, taken: list[Signal]) -> None:
        subtract = self._subtracts(m)
        width = self.form.width
        other = fitted(taken[1], width, True) ^ subtract.replicate(width).as_signed()
        m.d.comb += self.result.eq(delayed(m, taken[0] + other + subtract, self._registers, "sum"))

    def _divides(self, m: Module, taken: list[Signal]) -> None:
        typed = self._plan.typed
        assert isinstance(typed, TypedGraph)
        if self.unit.busy > 1:
            inner = iterative_division(typed, self.core.operands, self.form)
            m.d.sync += inner.start.eq(self.start)
        else:
            inner = division(typed, self.core.operands, self.form, self._registers, self._on_block)
        m.submodules.core = inner
        if len(taken) == 2:
            m.d.comb += inner.dividend.eq(taken[0])
        m.d.comb += [inner.divisor.eq(taken[-1]), self.result.eq(inner.quotient)]
