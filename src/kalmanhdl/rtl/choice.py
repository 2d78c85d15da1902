"""One of several values, by number."""

from collections.abc import Sequence

from amaranth.hdl import Module, Shape, Signal, Value


def chosen(m: Module, name: str, select: Value, sources: Sequence[Value], shape: Shape) -> Value:
    """The source of a number, as a signal of a shape; the last one also stands for numbers beyond."""
    if len(sources) == 1:
        return sources[0]
    signal = Signal(shape, name=f"{name}_chosen")
    with m.Switch(select):
        for number, source in enumerate(sources[:-1]):
            with m.Case(number):
                m.d.comb += signal.eq(source)
        with m.Default():
            m.d.comb += signal.eq(sources[-1])
    return signal
