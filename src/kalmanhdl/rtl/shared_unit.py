"""An operator on which several operations take turns: registers for its operands, then its core."""

from collections.abc import Callable

from amaranth.hdl import Module, Signal
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.operators import division
from kalmanhdl.rtl.shapes import fitted, shape_of
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.sharing import Core, core
from kalmanhdl.schedule.storage import Port, ports


class SharedUnit(Component):
    """Ports ``operand_<k>``, ``result`` and, for sums, ``subtract``: the second operand is taken away.

    The result stands as many clocks after the operands as the operations on it have registers. All numbers
    are raw integers.
    """

    def __init__(self, plan: Plan, number: int) -> None:
        unit = plan.units[number]
        self._plan, self.unit = plan, unit
        self.core: Core = core(plan.typed, unit.kind, plan.sharing.operations[unit.kind])
        self.choices: tuple[Port, ...] = ports(plan, unit)
        self._registers = plan.registers[unit.operations[0]] - 1
        operands = {f"operand_{k}": In(shape_of(one.form)) for k, one in enumerate(self.core.operands)}
        sign = {"subtract": In(1)} if unit.kind in ("add", "subtract") else {}
        super().__init__({**operands, **sign, "result": Out(shape_of(self.core.form))})

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
            "add": self._adds,
            "subtract": self._adds,
        }.get(self.unit.kind, self._divides)
        build(m, taken)
        return m

    def _multiplies(self, m: Module, taken: list[Signal]) -> None:
        on_block = bool(self._plan.on_multiplier_block & frozenset(self.unit.operations))
        a, b = (shape_of(one.form) for one in self.core.operands)
        m.submodules.core = inner = Multiplier(
            a, b, self._registers, on_block, self._plan.typed.logic_product
        )
        m.d.comb += [inner.a.eq(taken[0]), inner.b.eq(taken[1]), self.result.eq(inner.product)]

    def _adds(self, m: Module, taken: list[Signal]) -> None:
        subtract = Signal(name="taken_subtract", reset_less=True)
        m.d.sync += subtract.eq(self.subtract)
        width = self.form.width
        other = fitted(taken[1], width, True) ^ subtract.replicate(width).as_signed()
        m.d.comb += self.result.eq(taken[0] + other + subtract)

    def _divides(self, m: Module, taken: list[Signal]) -> None:
        on_block = bool(self._plan.on_multiplier_block & frozenset(self.unit.operations))
        inner = division(self._plan.typed, self.core.operands, self.form, self._registers, on_block)
        m.submodules.core = inner
        if len(taken) == 2:
            m.d.comb += inner.dividend.eq(taken[0])
        m.d.comb += [inner.divisor.eq(taken[-1]), self.result.eq(inner.quotient)]
