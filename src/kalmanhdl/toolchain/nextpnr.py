"""nextpnr for ECP5: place and route a core, several seeds at once, and read back what came out.

The core stands out of context: no pads, and an ideal clock without skew. (The same core between
registers with a real clock pad reaches the same frequency within one per cent.)
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from kalmanhdl.errors import ToolError
from kalmanhdl.target.device import Device
from kalmanhdl.toolchain import cache
from kalmanhdl.toolchain.process import Job, run_all, working_folder
from kalmanhdl.toolchain.yosys import Netlist
from kalmanhdl.toolchain.yowasp import NEXTPNR_ECP5, ensure_warm, version

_KIND = "nextpnr"
_REPORT = "report.json"
# Of LUTs and carries together. In larger cores the usual router rips up far more than it lays; the one that
# negotiates ends, and the placer beside it leaves wires a fifth shorter.
_LARGE = 13_000
_FOR_LARGE = ("--placer", "static", "--router", "router2")


@dataclass(frozen=True, slots=True, kw_only=True)
class Hop:
    """One piece of a path: logic through a cell, or routing over a net, with its delay in ns."""

    kind: str
    cell: str
    port: str
    net: str
    delay_ns: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Implementation:
    """A placed and routed core, with the figures as nextpnr reports them."""

    device: str
    grade: int
    seed: int
    tool: str
    fmax_mhz: float
    luts: int
    ffs: int
    multipliers: int
    block_rams: int
    seconds: float
    critical_path: tuple[Hop, ...]


def place_and_route(
    netlist: Netlist, device: Device, seeds: Sequence[int], clock_mhz: float, jobs: int | None = None
) -> tuple[Implementation, ...]:
    """Place and route with every seed, ``jobs`` at once (default: one a processor); in their order.

    ``clock_mhz`` is what the tool strives for; a core that misses it is a result, not an error.
    Raises ToolError, also where the core does not fit the device or has no path between registers.
    """
    if not device.package:
        raise ToolError(
            f"device {device.name}: there is no place and route for it, only for the ecp5 devices"
        )
    options = {seed: _options(netlist, device, seed, clock_mhz) for seed in seeds}
    parts = {seed: (version(NEXTPNR_ECP5), netlist.json, *options[seed]) for seed in seeds}
    missing = [seed for seed in parts if cache.find(_KIND, parts[seed]) is None]
    reports = _run(netlist, {seed: options[seed] for seed in missing}, jobs or os.cpu_count() or 1)
    for seed, report in zip(missing, reports, strict=True):
        cache.entry(_KIND, parts[seed], partial(_write, report))
    return tuple(_read(parts[seed], device, seed) for seed in seeds)


def best(implementations: Iterable[Implementation]) -> Implementation:
    """The fastest; among equals the one of the lowest seed."""
    return min(implementations, key=lambda one: (-one.fmax_mhz, one.seed))


def _options(netlist: Netlist, device: Device, seed: int, clock_mhz: float) -> tuple[str, ...]:
    part = device.name.removeprefix(f"{device.family}-")
    logic = netlist.cells.get("LUT4", 0) + 2 * netlist.cells.get("CCU2C", 0)
    return (
        *(f"--{part}", "--package", device.package, "--speed", str(device.grade), "--out-of-context"),
        *("--freq", f"{clock_mhz:g}", "--timing-allow-fail", "--seed", str(seed)),
        *(_FOR_LARGE if logic > _LARGE else ()),
    )


def _run(netlist: Netlist, options: Mapping[int, tuple[str, ...]], jobs: int) -> list[str]:
    """The results as JSON text, a seed after the other: nextpnr's report and the seconds it took."""
    if not options:
        return []
    ensure_warm(NEXTPNR_ECP5)
    with working_folder() as work:
        calls = [_call(netlist, work / str(seed), given) for seed, given in options.items()]
        runs = run_all(calls, parallel=jobs)
        reports = [json.loads((call.folder / _REPORT).read_text()) for call in calls]
    return [json.dumps({"seconds": one.seconds, **report}) for one, report in zip(runs, reports, strict=True)]


def _call(netlist: Netlist, folder: Path, options: tuple[str, ...]) -> Job:
    folder.mkdir()
    (folder / "netlist.json").write_text(netlist.json)
    arguments = ("--json", "netlist.json", "--top", netlist.top, "--report", _REPORT, "--quiet", *options)
    return Job(tool=NEXTPNR_ECP5, arguments=arguments, folder=folder)


def _write(text: str, folder: Path) -> None:
    (folder / _REPORT).write_text(text)


def _read(parts: tuple[str, ...], device: Device, seed: int) -> Implementation:
    place = cache.find(_KIND, parts)
    assert place is not None, "just published"
    return parse_report((place / _REPORT).read_text(), device, seed)


def parse_report(text: str, device: Device, seed: int) -> Implementation:
    """The figures of nextpnr's JSON report. Raises ToolError where nothing was timed."""
    report = json.loads(text)
    used = {name: figures["used"] for name, figures in report["utilization"].items()}
    if not report["fmax"]:
        raise ToolError("nextpnr-ecp5 timed nothing: the design has no path between two registers")
    return Implementation(
        device=device.name,
        grade=device.grade,
        seed=seed,
        tool=version(NEXTPNR_ECP5),
        fmax_mhz=min(clock["achieved"] for clock in report["fmax"].values()),
        luts=used.get("TRELLIS_COMB", 0),
        ffs=used.get("TRELLIS_FF", 0),
        multipliers=used.get("MULT18X18D", 0),
        block_rams=used.get("DP16KD", 0),
        seconds=report["seconds"],
        critical_path=_critical_path(report["critical_paths"]),
    )


def _critical_path(paths: list[dict[str, Any]]) -> tuple[Hop, ...]:
    """The longest path between two clock edges; paths of the core's ports are not its own."""
    inner: list[list[dict[str, Any]]] = [
        path["path"] for path in paths if path["from"] != "<async>" and path["to"] != "<async>"
    ]
    slowest = max(inner, key=lambda hops: sum(float(hop["delay"]) for hop in hops), default=[])
    return tuple(
        Hop(
            kind=hop["type"],
            cell=hop["to"]["cell"],
            port=hop["to"]["port"],
            net=hop.get("net", ""),
            delay_ns=round(hop["delay"], 4),
        )
        for hop in slowest
    )
