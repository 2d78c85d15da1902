"""The functions of FUNC: an operator for each operation of their graph, an instruction in every clock."""

from amaranth.hdl import Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.function_stages import function_clocks, function_plan
from kalmanhdl.processor.functions import ARGUMENTS, Root, function_graph
from kalmanhdl.processor.hardware.layouts import word_shape
from kalmanhdl.processor.instructions import ARGUMENT_BITS, FUNCTIONS
from kalmanhdl.rtl.float_values import FloatValues
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.timeline import Phases
from kalmanhdl.rtl.values import Values


class FunctionUnit(wiring.Component):
    """Takes elements 0 and 1 of the source in every clock; all functions of them stand
    ``function_stages.function_clocks`` later. ``function`` chooses among these: that of the instruction whose
    ``value`` and ``outside`` are there.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        word = word_shape(core)
        super().__init__(
            {
                "a": In(word),
                "b": In(word),
                "function": In(ARGUMENT_BITS),
                "value": Out(word),
                "outside": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        phases = Phases(m, 1)
        inputs: dict[str, Value] = dict(zip(ARGUMENTS, (self.a, self.b), strict=True))
        kind = FloatValues if self._core.floating else Values
        values = kind(m, phases, function_plan(self._core), inputs, {}, ())
        last = function_clocks(self._core)
        value: Value = Const(0, word_shape(self._core))
        outside: Value = Const(0)
        for root in function_graph(self._core).roots:
            is_it = self.function == FUNCTIONS.index(root.function)
            value = Mux(is_it, self._aligned(values, root, last), value)
            flags = [values.at(flag, last) for flag in root.outside]
            outside = Mux(is_it, sum(flags, start=Const(0)).any(), outside)
        m.d.comb += [self.value.eq(value), self.outside.eq(outside)]
        phases.finish()
        return m

    def _aligned(self, values: Values, root: Root, last: int) -> Value:
        """The value in the format of the core, which may have bits below its last one."""
        form = function_graph(self._core).typed.formats[root.value]
        if not isinstance(form, Fixed):
            return values.at(root.value, last)
        raw = values.at(root.value, last).shift_left(self._core.fixed_form.fraction - form.fraction)
        return fitted(raw, self._core.form.width, True)
