"""A test bench of cocotb: sends the steps of stimulus.csv and holds what comes out against expected.csv.

README.md beside this file says what stands in the tables. This file needs cocotb 2 and nothing else.
"""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, RisingEdge

FOLDER = Path(__file__).parent
RESET_CLOCKS = 4
# Clocks in which nothing moves before the design counts as stuck, beside what a side pauses.
PATIENCE = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A port that carries a number, and what its raw integers stand for."""

    name: str
    width: int
    signed: bool
    signal: str
    last_bit: float | None

    def words(self, raw: int) -> str:
        """A raw number as its digits, its value as an integer, and what that stands for."""
        value = raw - (1 << self.width) if self.signed and raw >> (self.width - 1) else raw
        real = "" if self.last_bit is None else f" = {value * self.last_bit:.9g}"
        return f"0x{raw:0{-(-self.width // 4)}x} ({value}{real})"


@dataclass(frozen=True, slots=True, kw_only=True)
class Token:
    """A row of a table: clocks of pause before it, the clock in which it is due, a number for each port."""

    line: int
    pause: int
    clock: int | None
    numbers: tuple[int, ...]


class Stream:
    """One pair of streams in one section: what is still to be sent, and what is still to come."""

    def __init__(self, dut: Any, prefix: str, inputs: Sequence[Port], outputs: Sequence[Port]) -> None:
        self._prefix = prefix
        self._in_valid, self._in_ready = dut[f"{prefix}in_valid"], dut[f"{prefix}in_ready"]
        self._out_valid, self._out_ready = dut[f"{prefix}out_valid"], dut[f"{prefix}out_ready"]
        self._inputs = [dut[port.name] for port in inputs]
        self._outputs = [(port, dut[port.name]) for port in outputs]
        self.load([], [])

    def load(self, sent: Sequence[Token], expected: Sequence[Token]) -> None:
        """Begin a section."""
        self._sent, self._expected = sent, expected
        self._accepted = self._taken = 0
        self._in_pause, self._out_pause = _pause(sent, 0), _pause(expected, 0)
        self._offering = self._taking = False

    @property
    def done(self) -> bool:
        """Whether everything was sent and everything has come."""
        return self._accepted == len(self._sent) and self._taken == len(self._expected)

    def drive(self) -> None:
        """Set the inputs of the next clock. What is offered stands until it is accepted."""
        if not self._offering and self._accepted < len(self._sent):
            self._offering, self._in_pause = self._in_pause == 0, max(0, self._in_pause - 1)
            if self._offering:
                for port, number in zip(self._inputs, self._sent[self._accepted].numbers, strict=True):
                    port.value = number
        self._taking = self._taken < len(self._expected) and self._out_pause == 0
        self._out_pause = max(0, self._out_pause - 1)
        self._in_valid.value = int(self._offering)
        self._out_ready.value = int(self._taking)

    def look(self, clock: int) -> bool:
        """What was transferred in a clock; whether anything was."""
        accepted = self._offering and self._bit(self._in_ready, clock)
        taken = self._bit(self._out_valid, clock) and self._taking
        if accepted:
            self._accepted += 1
            self._in_pause, self._offering = _pause(self._sent, self._accepted), False
        if taken:
            self._check(self._expected[self._taken], clock)
            self._taken += 1
            self._out_pause = _pause(self._expected, self._taken)
        return accepted or taken

    def check_silence(self, clock: int) -> None:
        """Fail where there is a result beyond those that are expected."""
        if self._expected and self._bit(self._out_valid, clock):
            message = f"{self._prefix}out_valid: expected no further result after {self._taken}, got one"
            raise AssertionError(f"{message} in clock {clock}")

    @property
    def progress(self) -> str:
        """How far a section has come."""
        sent, expected = len(self._sent), len(self._expected)
        return f"{self._accepted} of {sent} steps taken, {self._taken} of {expected} results given"

    def _bit(self, port: Any, clock: int) -> bool:
        number = _number(port)
        assert number is not None, f"{port._name}: expected 0 or 1, got {port.value} in clock {clock}"
        return bool(number)

    def _check(self, token: Token, clock: int) -> None:
        where = f"step {self._taken}, {{}} (expected.csv, line {token.line}): "
        for (port, handle), wanted in zip(self._outputs, token.numbers, strict=True):
            found = _number(handle)
            if found != wanted:
                got = f"no value: {handle.value}" if found is None else port.words(found)
                what = where.format(f"{port.name}, {port.signal}")
                raise AssertionError(f"{what}expected {port.words(wanted)}, got {got}")
        if token.clock is not None and token.clock != clock:
            what = where.format(f"{self._prefix}out_valid")
            raise AssertionError(f"{what}expected in clock {token.clock} after reset, got in clock {clock}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Vectors:
    """The tables: ports at zero, sections with the clocks that follow them, ports and tokens by stream."""

    held: list[str]
    sections: dict[str, int]
    inputs: dict[str, list[Port]]
    outputs: dict[str, list[Port]]
    sent: dict[tuple[str, str], list[Token]]
    expected: dict[tuple[str, str], list[Token]]


@cocotb.test()
async def vectors(dut: Any) -> None:
    """Every result is the expected one, and comes when it must."""
    read = read_vectors(FOLDER)
    streams = {
        prefix: Stream(dut, prefix, read.inputs[prefix], read.outputs[prefix]) for prefix in read.inputs
    }
    if hasattr(dut, "coefficient_write"):
        # The vectors are for the coefficients that the hardware begins with.
        dut.coefficient_write.value = 0
    for name in read.held:
        dut[name].value = 0
    Clock(dut.clk, 10, unit="ns").start()
    for name, wait in read.sections.items():
        dut.rst.value = 1
        for stream in streams.values():
            stream.load([], [])
        for _ in range(RESET_CLOCKS):
            await _clock(dut, streams.values(), None)
        dut.rst.value = 0
        for prefix, stream in streams.items():
            stream.load(read.sent.get((name, prefix), []), read.expected.get((name, prefix), []))
        try:
            clocks = await _section(dut, list(streams.values()), wait)
        except AssertionError as error:
            raise AssertionError(f"{dut._name}: section {name}, {error}") from None
        dut._log.info("section %s: %d clocks, as expected", name, clocks)


async def _section(dut: Any, streams: Sequence[Stream], wait: int) -> int:
    """Run a section to its end, and some clocks more; how many clocks it took."""
    clock = idle = 0
    while not all(stream.done for stream in streams):
        idle = 0 if await _clock(dut, streams, clock) else idle + 1
        clock += 1
        assert idle < PATIENCE, f"stuck: nothing moved for {PATIENCE} clocks, " + "; ".join(
            stream.progress for stream in streams
        )
    for last in range(clock, clock + wait):
        await _clock(dut, streams, last)
        for stream in streams:
            stream.check_silence(last)
    return clock + wait


async def _clock(dut: Any, streams: Any, clock: int | None) -> bool:
    """One clock, its inputs set after one rising edge and its outputs seen before the next."""
    for stream in streams:
        stream.drive()
    await FallingEdge(dut.clk)
    moved = [] if clock is None else [stream.look(clock) for stream in streams]
    await RisingEdge(dut.clk)
    return any(moved)


def read_vectors(folder: Path) -> Vectors:
    """The tables of a folder."""
    rows = list(_rows(folder / "ports.csv"))
    streams = dict.fromkeys(row["stream"] for row in rows)
    columns = {way: [c for c in _columns(rows) if c.startswith(way)] for way in ("in_", "out_")}
    return Vectors(
        held=[row["port"] for row in _rows(folder / "held.csv")],
        sections={row["section"]: int(row["wait"]) for row in _rows(folder / "sections.csv")},
        inputs={stream: _ports(rows, stream, "in_") for stream in streams},
        outputs={stream: _ports(rows, stream, "out_") for stream in streams},
        sent=_tokens(folder / "stimulus.csv", columns["in_"]),
        expected=_tokens(folder / "expected.csv", columns["out_"]),
    )


def _rows(path: Path) -> Iterator[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        yield from csv.DictReader(file)


def _columns(rows: list[dict[str, str]]) -> dict[str, None]:
    return dict.fromkeys(row["column"] for row in rows)


def _ports(rows: list[dict[str, str]], stream: str, way: str) -> list[Port]:
    return [
        Port(
            name=row["port"],
            width=int(row["width"]),
            signed=row["signed"] == "1",
            signal=row["signal"],
            last_bit=float(row["last_bit"]) if row["last_bit"] else None,
        )
        for row in rows
        if row["stream"] == stream and row["column"].startswith(way)
    ]


def _tokens(path: Path, columns: list[str]) -> dict[tuple[str, str], list[Token]]:
    found: dict[tuple[str, str], list[Token]] = {}
    for line, row in enumerate(_rows(path), 2):
        token = Token(
            line=line,
            pause=int(row["pause"]),
            clock=int(row["clock"]) if row.get("clock") else None,
            numbers=tuple(int(row[column], 16) for column in columns),
        )
        found.setdefault((row["section"], row["stream"]), []).append(token)
    return found


def _pause(tokens: Sequence[Token], at: int) -> int:
    return tokens[at].pause if at < len(tokens) else 0


def _number(port: Any) -> int | None:
    """What stands on a port; None where a bit of it is neither 0 nor 1."""
    try:
        return int(port.value)
    except ValueError:
        return None
