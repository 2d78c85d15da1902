"""An image as text: a table of its words, and a listing of what runs in which row."""

from collections.abc import Iterator

from kalmanhdl.graph.operations import Input
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.programmable.control import Layout
from kalmanhdl.programmable.image import Image
from kalmanhdl.programmable.interface import ports_in, ports_out
from kalmanhdl.programmable.operations import Fixture, Kept, Kind, Operation, Result, Word
from kalmanhdl.programmable.schedule import Schedule
from kalmanhdl.shape import Shape


def image_csv(image: Image) -> str:
    """The words of an image in the order in which they are written, one a line, and where each belongs."""
    rows = [f"{address},{word},{_place(image, address)}" for address, word in image.words]
    return "\n".join(["address,data,place", *rows]) + "\n"


def _place(image: Image, address: int) -> str:
    layout = Layout(image.shape)
    section, index = address >> layout.index_bits, address & ((1 << layout.index_bits) - 1)
    chunks = len(layout.chunk_widths)
    if section == 0:
        return "last row"
    if section <= chunks:
        return f"row {index} chunk {section - 1}"
    return f"{image.shape.files[section - 1 - chunks]} {index}"


def ports_text(typed: TypedGraph, shape: Shape) -> str:
    """What the numbers of a filter mean on the ports of a shape: formats, and the value of the last bit."""
    operations = typed.graph.operations
    forms = {op.name: typed.formats[k] for k, op in enumerate(operations) if isinstance(op, Input)}
    forms |= {name: typed.formats[root] for name, root in typed.graph.outputs}
    lines = [
        f"{port.name:<20} {port.signal:<14} {form!s:<28} {float(form.resolution) * scale!r}"
        for port in (*ports_in(shape), *ports_out(shape))
        if (form := forms.get(port.signal)) and (scale := typed.scales.get(port.signal, 1.0))
    ]
    return "\n".join([f"{'port':<20} {'number':<14} {'format':<28} last bit", *lines]) + "\n"


def listing(schedule: Schedule) -> str:
    """The operations of a step by the rows in which they begin."""
    order = sorted(range(len(schedule.starts)), key=lambda k: (schedule.starts[k], schedule.units[k]))
    return "".join(f"{line}\n" for line in _lines(schedule, order))


def _lines(schedule: Schedule, order: list[int]) -> Iterator[str]:
    yield "row   until  unit         result"
    for index in order:
        operation = schedule.step.operations[index]
        says = _says(operation)
        yield (
            f"{schedule.starts[index]:<5} {schedule.written[index]:<6} {schedule.units[index]:<12} "
            f"r{index} = {says}  {operation.origin}".rstrip()
        )


def _says(operation: Operation) -> str:
    words = [_word(word) for word in operation.operands]
    match operation.kind:
        case Kind.INPUT:
            return operation.input
        case Kind.RECIPROCAL:
            return f"{'table' if operation.exponent is None else f'2^{operation.exponent}'} / {words[0]}"
        case Kind.MULTIPLY:
            return f"{words[0]} * {words[1]}{_stage(operation)}"
        case Kind.ADD:
            return f"{operation.function.name.lower()} {', '.join(words)}{_stage(operation)}"


def _stage(operation: Operation) -> str:
    stage = operation.stage
    assert stage is not None
    kind = "s" if stage.signed else "u"
    return f" >> {stage.dropped} {stage.rounding.value}, {stage.overflow.value} to {kind}{stage.width}"


def _word(word: Word) -> str:
    match word:
        case Fixture(raw):
            return str(raw)
        case Kept(state, lift):
            return f"{state} << {lift}" if lift else state
        case Result(operation):
            return f"r{operation}"
