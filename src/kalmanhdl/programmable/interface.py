"""What programmable hardware looks like from outside, as plain data."""

from collections.abc import Iterator
from dataclasses import dataclass

from kalmanhdl.programmable.control import Layout
from kalmanhdl.rtl.interface import COMMAND_WIDTH
from kalmanhdl.rtl.names import identifier
from kalmanhdl.shape import Shape

LOADING = ("store_write", "store_address", "store_data")
"""The ports by which an image is written."""
COMMITTED = "step_ends"
"""The wire that is high in the clock in which a step ends and its states count."""
SATURATED = "saturated"


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A port of a stream; ``signal`` is what the graph calls it, or ``command``. Flags have one bit."""

    name: str
    signal: str
    width: int

    @property
    def is_signed(self) -> bool:
        """Whether its bits are in two's complement."""
        return self.width > COMMAND_WIDTH


def loading_widths(shape: Shape) -> tuple[tuple[str, int], ...]:
    """The ports by which an image is written, with their widths."""
    return tuple(zip(LOADING, (1, Layout(shape).image_address_bits, shape.word_width), strict=True))


def ports_in(shape: Shape) -> tuple[Port, ...]:
    """What comes with a step: a command, numbers, and which measurements are present."""
    return tuple(_ports_in(shape))


def _ports_in(shape: Shape) -> Iterator[Port]:
    yield Port(name="in_command", signal="command", width=COMMAND_WIDTH)
    for name in shape.inputs[:-1]:
        is_flag = name.startswith("valid")
        word = identifier(name.replace("valid", "present"))
        yield Port(name=f"in_{word}", signal=name, width=1 if is_flag else shape.number_width)


def ports_out(shape: Shape) -> tuple[Port, ...]:
    """What a step puts out."""
    numbers = (
        Port(name=f"out_{identifier(name)}", signal=name, width=shape.number_width) for name in shape.outputs
    )
    return (
        Port(name="out_command", signal="command", width=COMMAND_WIDTH),
        *numbers,
        Port(name=f"out_{SATURATED}", signal=SATURATED, width=1),
    )
