"""The coefficients of a filter: registers that a port writes, one a coefficient."""

from amaranth.hdl import Module, Signal
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.rtl.interface import Interface
from kalmanhdl.rtl.layouts import shape


class Coefficients(Component):
    """Each coefficient stands on a port of its own, by its field; before it is written, as ``first`` says.

    ``coefficient_data`` is stored at ``coefficient_address`` in a clock in which ``coefficient_write`` is
    high. Reset leaves what was stored.
    """

    def __init__(self, shown: Interface, first: dict[str, int]) -> None:
        self._shown, self._first = shown, first
        loading = {name: In(width) for name, width in shown.loading}
        super().__init__(loading | {port.field: Out(shape(port.form)) for port in shown.coefficients})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        for address, port in enumerate(self._shown.coefficients):
            kept = Signal(
                shape(port.form), name=f"kept_{port.field}", init=self._first[port.signal], reset_less=True
            )
            with m.If(self.coefficient_write & (self.coefficient_address == address)):
                m.d.sync += kept.eq(self.coefficient_data)
            m.d.comb += getattr(self, port.field).eq(kept)
        return m
