"""Registers inside an operator: values carried from step to step of a chain."""

from collections.abc import Sequence

from amaranth.hdl import Module, Signal, Value

from kalmanhdl.arithmetic.pipelining import register_places


def named(m: Module, name: str, value: Value) -> Signal:
    """A signal that has the value, so that an expression is built once however often it is read."""
    signal = Signal(value.shape(), name=name)
    m.d.comb += signal.eq(value)
    return signal


def delayed(m: Module, value: Value, clocks: int, name: str) -> Value:
    """A value some clocks later. Its registers run freely and have no reset."""
    for index in range(clocks):
        register = Signal(value.shape(), name=f"{name}_{index}", reset_less=True)
        m.d.sync += register.eq(value)
        value = register
    return value


class Stages:
    """The registers of one operator, laid where its chain of steps is cut best."""

    def __init__(self, m: Module, weights: Sequence[float], registers: int) -> None:
        self._m = m
        self._places = register_places(weights, registers)

    def before(self, step: int, values: dict[str, Value]) -> dict[str, Value]:
        """The values as a step reads them; the step after the last one is the end of the operator.

        No register ever stands before the first step, 0.
        """
        clocks = self._places[step]
        return {name: delayed(self._m, value, clocks, f"{name}_{step}") for name, value in values.items()}
