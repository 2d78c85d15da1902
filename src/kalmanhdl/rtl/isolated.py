"""A component alone between registers, to be measured."""

from amaranth.hdl import Module, Shape, Signal, Value
from amaranth.lib.data import Layout
from amaranth.lib.wiring import Component, Flow, In, Member, Out


class Between(Component):
    """A component with a row of registers before its inputs and one behind its outputs, and its own ports."""

    def __init__(self, core: Component) -> None:
        self._core = core
        super().__init__({name: _plain(member) for name, member in core.signature.members.items()})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.core = self._core
        for name, member in self._core.signature.members.items():
            inner, outer = (getattr(one, name) for one in (self._core, self))
            source, sink = (outer, inner) if member.flow == Flow.In else (inner, outer)
            register = Signal(Shape(len(Value.cast(source))), name=f"between_{name}", reset_less=True)
            m.d.sync += register.eq(source)
            m.d.comb += sink.eq(register)
        return m


def _plain(member: Member) -> Member:
    """A port of as many bits."""
    shape = member.shape
    width = shape.size if isinstance(shape, Layout) else Shape.cast(shape).width
    return In(width) if member.flow == Flow.In else Out(width)
