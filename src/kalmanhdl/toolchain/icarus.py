"""Icarus Verilog: the Verilog that the user gets under a bench in Verilog, stimuli and traces as text."""

import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.errors import VerificationError
from kalmanhdl.toolchain import cache
from kalmanhdl.toolchain.harness import Border, Stream, Watch
from kalmanhdl.toolchain.installed import installed, version_line
from kalmanhdl.toolchain.process import Tool, run, working_folder
from kalmanhdl.toolchain.simulation import PATIENCE, Run, Sent, Stalls, Trace, Traces

_REMEDY = "install Icarus Verilog (Debian: apt-get install iverilog), or choose another simulator"
_TEMPLATE = "icarus_bench.v.j2"
_DESIGN, _BENCH, _PROGRAM = "design.v", "bench.v", "simulation.vvp"
_SEED_STEP = 0x5851F42D4C957F2D

Ports = tuple[tuple[str, int], ...]


def iverilog() -> Tool:
    """The compiler. Raises ToolError where there is none."""
    return installed("iverilog", _REMEDY)


def vvp() -> Tool:
    """What runs a compiled design. Raises ToolError where there is none."""
    return installed("vvp", _REMEDY)


@dataclass(frozen=True, slots=True, kw_only=True)
class Icarus:
    """A design compiled with a bench for Icarus, which makes all runs in one go."""

    program: Path
    name: str = "icarus"

    def run(self, border: Border, runs: Iterable[Run]) -> Iterator[Traces]:
        """As ``Simulate`` says. Numbers without a value are none: VerificationError names port and cycle."""
        wanted = list(runs)
        with working_folder() as work:
            shutil.copyfile(self.program, work / _PROGRAM)
            _write_stimuli(work, border, wanted)
            run(vvp(), ("-n", _PROGRAM), work)
            records = _Records(border, (work / "trace.txt").read_text().splitlines())
        return records.traces(wanted)


def compile_bench(verilog: str, top: str, border: Border) -> Path:
    """Compile a Verilog design with its bench; cached by content. Raises ToolError."""
    tool = iverilog()
    bench = _bench(top, border)

    def make(folder: Path) -> None:
        with working_folder() as work:
            (work / _DESIGN).write_text(verilog)
            (work / _BENCH).write_text(bench)
            run(tool, ("-g2005", "-o", _PROGRAM, _DESIGN, _BENCH), work)
            shutil.copyfile(work / _PROGRAM, folder / _PROGRAM)

    return cache.entry("icarus", (version_line(tool, "-V"), verilog, bench), make) / _PROGRAM


def _bench(top: str, border: Border) -> str:
    from jinja2 import Environment, StrictUndefined

    template = files(__package__).joinpath(_TEMPLATE).read_text()
    environment = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(template).render(top=top, border=border, patience=PATIENCE)


def _write_stimuli(work: Path, border: Border, runs: list[Run]) -> None:
    """runs.txt: a line a run; tokens_<pair>.txt: a line a token, the ports of its source in one number."""
    lines = []
    for each in runs:
        counts = [f"{len(sent.tokens)} {sent.results}" for sent in each.sent]
        stalls = [_stall(each.stalls, pair) for pair in range(len(each.sent))]
        lines.append(" ".join(f"{count} {stall}" for count, stall in zip(counts, stalls, strict=True)))
    (work / "runs.txt").write_text("".join(f"{line}\n" for line in lines))
    for number, (source, _) in enumerate(border.pairs):
        tokens = [each.sent[number].tokens for each in runs]
        (work / f"tokens_{number}.txt").write_text(
            "".join(_token_lines(np.concatenate(tokens), source.payload))
        )


def _stall(stalls: Stalls, pair: int) -> str:
    """The states and thresholds that the compiled harness has."""
    seed = (stalls.seed + pair * _SEED_STEP) % 2**64
    thresholds = (min(int(p * 2.0**64), 2**64 - 1) for p in (stalls.source, stalls.sink))
    return " ".join(f"{word:x}" for word in (seed, seed ^ (2**64 - 1), *thresholds))


def _token_lines(tokens: NDArray[np.uint64], ports: Ports) -> Iterator[str]:
    for row in tokens.tolist():
        number, place = 0, 0
        for _, width in ports:
            words = -(-width // 64)
            value = sum(word << (64 * k) for k, word in enumerate(row[place : place + words]))
            number, place = number << width | value, place + words
        yield f"{number:x}\n"


class _Records:
    """What the bench wrote: a line a transfer or record, beginning with a letter for its kind."""

    def __init__(self, border: Border, lines: list[str]) -> None:
        self._border = border
        self._lines = iter(lines)

    def traces(self, runs: list[Run]) -> Iterator[Traces]:
        for each in runs:
            yield self._trace(each)

    def _trace(self, wanted: Run) -> Traces:
        accepted: list[list[int]] = [[] for _ in wanted.sent]
        produced: list[list[int]] = [[] for _ in wanted.sent]
        outputs: list[list[list[int]]] = [[] for _ in wanted.sent]
        watched: list[list[list[int]]] = [[] for _ in self._border.watches]
        for line in self._lines:
            kind, number, cycle, *words = line.split()
            match kind:
                case "accepted":
                    accepted[int(number)].append(int(cycle))
                case "produced":
                    produced[int(number)].append(int(cycle))
                    outputs[int(number)].append(
                        _words(words, self._border.pairs[int(number)][1].payload, cycle)
                    )
                case "watched":
                    watched[int(number)].append(_words(words, self._border.watches[int(number)].wires, cycle))
                case "stuck":
                    raise VerificationError(_stuck(wanted.sent, accepted, produced, cycle))
                case _:
                    break
        else:
            raise VerificationError("the simulation ended before its last run was done")
        room = sum(len(sent.tokens) for sent in wanted.sent)
        looks = tuple(
            _array(records[: room * watch.most], watch)
            for records, watch in zip(watched, self._border.watches, strict=True)
        )
        return tuple(
            Trace(
                outputs=_array(out, sink),
                accepted_at=np.array(taken, np.int64),
                produced_at=np.array(given, np.int64),
                cycles=int(cycle),
                watched=looks,
            )
            for out, taken, given, (_, sink) in zip(
                outputs, accepted, produced, self._border.pairs, strict=True
            )
        )


def _array(rows: list[list[int]], of: Stream | Watch) -> NDArray[np.uint64]:
    return np.array(rows, np.uint64).reshape(len(rows), of.words)


def _words(values: list[str], ports: Ports, cycle: str) -> list[int]:
    """The 64-bit words of ports, low word first, from their hexadecimal digits."""
    words = []
    for digits, (name, width) in zip(values, ports, strict=True):
        try:
            value = int(digits, 16)
        except ValueError:
            raise VerificationError(f"{name} has no value in cycle {cycle}: {digits!r}") from None
        words += [value >> (64 * k) & (2**64 - 1) for k in range(-(-width // 64))]
    return words


def _stuck(sent: tuple[Sent, ...], accepted: list[list[int]], produced: list[list[int]], cycle: str) -> str:
    went, came = sum(map(len, accepted)), sum(map(len, produced))
    tokens, results = sum(len(each.tokens) for each in sent), sum(each.results for each in sent)
    return (
        f"the simulated design is stuck: nothing moved for {PATIENCE} cycles (cycle {cycle}, "
        f"{went} of {tokens} tokens accepted and {came} of {results} produced)"
    )
