"""When and where the operations of a step run: a list schedule with every file's one write a clock."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from kalmanhdl.errors import ScheduleError
from kalmanhdl.programmable.control import busy_clocks, written_after
from kalmanhdl.programmable.operations import Kept, Operation, Result, Step, Word
from kalmanhdl.shape import Shape

OUTPUT = "output"
"""The registers of the outputs, which are written as files are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """A step on the units of a shape.

    Operation k runs on the unit ``units[k]`` from the row ``starts[k]`` on, and is written to the files
    ``targets[k]`` in the row ``written[k]``. ``reads[file]`` are the words that stand in a file, each with
    the last row that reads it. ``rows`` is how many rows a step takes.
    """

    step: Step
    units: tuple[str, ...]
    starts: tuple[int, ...]
    written: tuple[int, ...]
    targets: tuple[tuple[str, ...], ...]
    reads: Mapping[str, Mapping[Word, int]]
    rows: int


def scheduled(step: Step, shape: Shape) -> Schedule:
    """A schedule of a step, as short as a list gives it. Raises ScheduleError where it has too many rows."""
    units = _bound(step, shape)
    targets = _targets(step, shape, units)
    starts = _placed(step, units, targets, _most_urgent_first(step))
    written = tuple(
        start + written_after(operation) for start, operation in zip(starts, step.operations, strict=True)
    )
    rows = max(written) + 1
    if rows > shape.rows:
        raise ScheduleError(
            f"the step takes {rows} rows of control, and the store has {shape.rows}: build hardware with "
            f"[architecture] rows = {power_of_two(rows)}, or with more units"
        )
    return Schedule(
        step=step,
        units=units,
        starts=starts,
        written=written,
        targets=targets,
        reads=_reads(step, shape, units, starts),
        rows=rows,
    )


def power_of_two(number: int) -> int:
    """The least one that is not below a number."""
    return 1 << (number - 1).bit_length()


def file_of(shape: Shape, unit: str, place: int) -> str:
    """The file before a port of a unit."""
    return f"{unit}_{shape.ports(unit)[place]}"


def _bound(step: Step, shape: Shape) -> tuple[str, ...]:
    """A unit for every operation: the one that has least to do, and of these one that reads alike."""
    load: dict[str, int] = dict.fromkeys(shape.unit_names, 0)
    known: dict[str, set[Word]] = defaultdict(set)
    found = []
    for operation in step.operations:
        fit = [unit for unit in shape.unit_names if unit.partition("_")[0] == operation.kind.value]
        words = set(operation.operands)
        unit = min(fit, key=lambda each: (load[each], -len(words & known[each])))
        load[unit] += 1
        known[unit] |= words
        found.append(unit)
    return tuple(found)


def _targets(step: Step, shape: Shape, units: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """The files that each operation is written to: those its readers read, in this step and the next."""
    readers: dict[Word, set[str]] = defaultdict(set)
    for operation, unit in zip(step.operations, units, strict=True):
        for place, word in enumerate(operation.operands):
            readers[word].add(file_of(shape, unit, place))
    found: list[set[str]] = [set(readers[Result(k)]) for k in range(len(step.operations))]
    for word, files in readers.items():
        if isinstance(word, Kept):
            found[step.states[word]] |= files
    for put in step.outputs.values():
        found[put].add(OUTPUT)
    return tuple(tuple(sorted(each)) for each in found)


def _most_urgent_first(step: Step) -> list[int]:
    """The operations by the clocks that must still pass behind them."""
    behind = [0] * len(step.operations)
    for index in reversed(range(len(step.operations))):
        behind[index] += written_after(step.operations[index]) + 1
        for word in step.operations[index].operands:
            if isinstance(word, Result):
                behind[word.operation] = max(behind[word.operation], behind[index])
    return sorted(range(len(behind)), key=lambda index: (-behind[index], index))


def _placed(
    step: Step, units: Sequence[str], targets: Sequence[tuple[str, ...]], order: Sequence[int]
) -> tuple[int, ...]:
    starts: dict[int, int] = {}
    busy: set[tuple[str, int]] = set()
    for index in order:
        operation, unit = step.operations[index], units[index]
        row, after, clocks = _ready(step, operation, starts), written_after(operation), busy_clocks(operation)
        while any((unit, row + k) in busy for k in range(clocks)) or any(
            (file, row + after) in busy for file in targets[index]
        ):
            row += 1
        starts[index] = row
        busy |= {(unit, row + k) for k in range(clocks)}
        busy |= {(file, row + after) for file in targets[index]}
    return tuple(starts[index] for index in range(len(starts)))


def _ready(step: Step, operation: Operation, starts: Mapping[int, int]) -> int:
    """The first row in which all operands can be read: what gives them is placed already."""
    return max(
        (
            starts[word.operation] + written_after(step.operations[word.operation]) + 1
            for word in operation.operands
            if isinstance(word, Result)
        ),
        default=0,
    )


def _reads(
    step: Step, shape: Shape, units: Sequence[str], starts: Sequence[int]
) -> dict[str, dict[Word, int]]:
    found: dict[str, dict[Word, int]] = {file: {} for file in shape.files}
    for operation, unit, start in zip(step.operations, units, starts, strict=True):
        for place, word in enumerate(operation.operands):
            last = found[file_of(shape, unit, place)]
            last[word] = max(last.get(word, 0), start)
    return found
