"""The image of a filter: what is written to the control store and the files of a programmable datapath."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from kalmanhdl.arithmetic.fixed import Overflow
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.programmable.allocation import Places, allocated
from kalmanhdl.programmable.control import (
    EXACT,
    HEADER,
    MOST_DROPPED,
    OPERANDS,
    QUOTIENT_BITS_PER_CLOCK,
    ROUNDED,
    SHIFTED,
    WATCH_RUNNING,
    WATCH_STARTING,
    Layout,
    quotient_clocks,
)
from kalmanhdl.programmable.lowering import lowered
from kalmanhdl.programmable.operations import (
    ROUNDING_CODES,
    Fixture,
    Kept,
    Kind,
    Operation,
    Result,
    Stage,
    Word,
)
from kalmanhdl.programmable.schedule import OUTPUT, Schedule, file_of, scheduled
from kalmanhdl.shape import Shape


@dataclass(frozen=True, slots=True, kw_only=True)
class StateWrite:
    """A state that is written to a file in each step: ``address`` is that of its lower place."""

    file: str
    address: int
    kept: Kept


@dataclass(frozen=True, slots=True, kw_only=True)
class Image:
    """A filter bound to a shape.

    ``rows`` are the packed rows of the store, ``files`` the words of each file from its lowest address on:
    numbers of the model, and zeros where states begin. ``state_writes`` stand in the order of their rows.
    """

    shape: Shape
    schedule: Schedule
    rows: tuple[int, ...]
    files: Mapping[str, tuple[int, ...]]
    state_writes: tuple[StateWrite, ...]
    words_used: Mapping[str, int]

    @property
    def words(self) -> tuple[tuple[int, int], ...]:
        """What to write, in order: addresses, and words as unsigned integers. The last one is the header."""
        return tuple(self._words())

    def _words(self) -> Iterator[tuple[int, int]]:
        layout = Layout(self.shape)
        bits = layout.index_bits
        for index, row in enumerate(self.rows):
            for chunk, word in enumerate(layout.chunks(row)):
                yield layout.chunk_section(chunk) << bits | index, word
        for file, words in self.files.items():
            mask = (1 << self.shape.file_width(file)) - 1
            for index, word in enumerate(words):
                yield layout.file_section(file) << bits | index, word & mask
        yield HEADER << bits, len(self.rows) - 1


def image_of(typed: TypedGraph, shape: Shape) -> Image:
    """The image of a step for the hardware of a shape.

    Raises DesignError, FormatError, ScheduleError, where it does not fit the shape.
    """
    schedule = scheduled(lowered(typed, shape), shape)
    places = allocated(schedule, shape)
    layout = Layout(shape)
    rows = _Rows(schedule, places, layout).filled()
    writes = [
        (schedule.written[schedule.step.states[kept]], StateWrite(file=file, address=address, kept=kept))
        for file, each in places.items()
        for kept, address in each.states.items()
    ]
    return Image(
        shape=shape,
        schedule=schedule,
        rows=tuple(map(layout.packed, rows)),
        files={file: _contents(each) for file, each in places.items()},
        state_writes=tuple(write for _, write in sorted(writes, key=lambda each: each[0])),
        words_used={file: each.used for file, each in places.items()},
    )


def _contents(places: Places) -> tuple[int, ...]:
    words = [0] * (2 * len(places.states)) + [0] * len(places.fixed)
    for word, address in places.fixed.items():
        words[address] = word.raw
    return tuple(words)


class _Rows:
    """The fields of every row, filled operation by operation, each in the row in which it counts."""

    def __init__(self, schedule: Schedule, places: Mapping[str, Places], layout: Layout) -> None:
        self._schedule, self._places, self._layout = schedule, places, layout
        self._shape = layout.shape
        self._banked = 1 << (layout.address_bits - 1)
        self._rows: Sequence[dict[str, int]] = [{} for _ in range(schedule.rows)]
        self._takers = {operation: kept for kept, operation in schedule.step.states.items()}
        self._outputs = {
            operation: self._shape.outputs.index(name) for name, operation in schedule.step.outputs.items()
        }

    def filled(self) -> Sequence[dict[str, int]]:
        for index, operation in enumerate(self._schedule.step.operations):
            unit, start = self._schedule.units[index], self._schedule.starts[index]
            self._read(unit, start, operation)
            self._work(unit, start, operation)
            if operation.stage is not None:
                self._stage(unit, start, operation.stage)
            self._write(index, unit)
        return self._rows

    def _put(self, row: int, **fields: int) -> None:
        assert not self._rows[row].keys() & fields.keys(), (row, fields)
        self._rows[row] |= fields

    def _read(self, unit: str, start: int, operation: Operation) -> None:
        for place, word in enumerate(operation.operands):
            file = file_of(self._shape, unit, place)
            self._put(start, **{f"{file}_read": self._address(file, word)})

    def _address(self, file: str, word: Word) -> int:
        places = self._places[file]
        match word:
            case Fixture():
                return places.fixed[word]
            case Kept():
                return self._banked | places.states[word]
            case Result(operation):
                taker = self._takers.get(operation)
                if taker is not None and taker in places.states:
                    # The other bank, which the next step reads.
                    return self._banked | places.states[taker] | 1
                return places.passing[word]

    def _work(self, unit: str, start: int, operation: Operation) -> None:
        match operation.kind:
            case Kind.ADD:
                self._put(start + OPERANDS, **{f"{unit}_function": int(operation.function)})
            case Kind.RECIPROCAL:
                if operation.exponent is not None:
                    self._put(
                        start + OPERANDS,
                        reciprocal_begin=1,
                        reciprocal_clocks=quotient_clocks(operation.exponent),
                        # Of the bits of the first clock that which is the dividend's one.
                        reciprocal_place=operation.exponent % QUOTIENT_BITS_PER_CLOCK,
                    )
            case Kind.INPUT:
                self._put(start, input_choice=self._shape.inputs.index(operation.input))
            case Kind.MULTIPLY:
                pass

    def _stage(self, unit: str, start: int, stage: Stage) -> None:
        self._put(start + EXACT, **{f"{unit}_shift": MOST_DROPPED - stage.dropped})
        self._put(
            start + SHIFTED,
            **{
                f"{unit}_rounding": ROUNDING_CODES[stage.rounding],
                f"{unit}_width": stage.width,
                f"{unit}_unsigned": int(not stage.signed),
            },
        )
        watch = WATCH_STARTING * stage.watch_starting | WATCH_RUNNING * stage.watch_running
        wraps = int(stage.overflow is Overflow.WRAP)
        self._put(start + ROUNDED, **{f"{unit}_wrap": wraps, f"{unit}_watch": watch})

    def _write(self, index: int, unit: str) -> None:
        row, source = self._schedule.written[index], self._shape.unit_names.index(unit)
        for file in self._schedule.targets[index]:
            address = self._outputs[index] if file == OUTPUT else self._address(file, Result(index))
            self._put(row, **{f"{file}_enable": 1, f"{file}_source": source, f"{file}_write": address})
