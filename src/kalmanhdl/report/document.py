"""A build as the dictionary that ``report.json`` holds.

Two builds of one design give equal dictionaries but for times: what stands under ``seconds``, and
``verification[].cycles_per_second``. Numbers that are not known are None, never NaN.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from kalmanhdl.algorithm.trace import components
from kalmanhdl.design import Architecture
from kalmanhdl.graph.builder import reachable
from kalmanhdl.graph.operations import Graph
from kalmanhdl.graph.simplify import counts
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.pipeline import Implemented
from kalmanhdl.report.accuracy import against_truth, differencing, mean_nis, nis_inside, updated
from kalmanhdl.report.formats import basis, formats, overflows, proofs
from kalmanhdl.report.papers import beside, paper_of
from kalmanhdl.report.record import Record
from kalmanhdl.schedule.summary import Summary
from kalmanhdl.simulate.metrics import rmse
from kalmanhdl.simulate.side_by_side import SideBySide, Simulation
from kalmanhdl.target import device
from kalmanhdl.toolchain.nextpnr import Implementation

SCHEMA = 1
_STAGES = ("trace", "schedule", "verify", "synthesise", "place_and_route")
_FIGURES = ("fmax_mhz", "luts", "ffs", "multipliers", "block_rams")


def document(record: Record) -> dict[str, Any]:
    """Everything of a build in plain values: the keys of the report, as DESIGN.md lists them, and more."""
    hardware, summary = record.hardware, record.summary
    needed, monitoring = operation_counts(hardware.numbers.graph)
    result: dict[str, Any] = {
        "design": hardware.design.name,
        "schema": SCHEMA,
        "model": _model(record),
        "algorithm": hardware.design.algorithm.kind,
        "operations": needed,
        "operations_monitoring": monitoring,
        "schedule": _schedule(summary, hardware.design.architecture),
        "estimates": _estimates(record, summary),
        "numerics": _numerics(record),
        "accuracy": _accuracy(record),
        "verification": [asdict(one) for one in record.verifications],
        "implementation": _implementation(record, summary),
        "synthesis": {one.family: asdict(one) for one in record.areas},
        "seconds": _seconds(record),
    }
    paper = paper_of(hardware.design.name)
    result["paper"] = paper and {
        "name": paper.name,
        "title": paper.title,
        "hardware": paper.hardware,
        "figures": beside(paper, result),
    }
    return plain(result)  # type: ignore[no-any-return]


def operation_counts(graph: Graph) -> tuple[dict[str, int], dict[str, int]]:
    """The operations that states and estimate need, and those that only innovation and NIS need on top."""
    estimate = [index for name, index in graph.outputs if name.startswith(("x[", "P["))]
    needed = reachable(graph.operations, [*(index for _, index in graph.states), *estimate])
    rest = reachable(graph.operations, graph.roots) - needed
    first, second = counts(graph.operations, needed), counts(graph.operations, rest)
    for found in (first, second):
        found["divisions_and_reciprocals"] = found["divide"] + found["reciprocal"]
    return first, second


def plain(value: Any) -> Any:
    """The same in values of JSON: arrays are lists, what is not finite is None."""
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _model(record: Record) -> dict[str, Any]:
    model = record.hardware.design.model
    parts = components(record.hardware.numbers.graph)
    names = {f"x[{i}]": name for i, name in enumerate(model.state_names)}
    return {
        "states": model.n,
        "measurements": model.m,
        "controls": model.p,
        "components": len(parts),
        "component_states": [[names[state] for state in part] for part in parts],
        **named(model),
    }


def named(model: Model) -> dict[str, Any]:
    """The names that a model gives."""
    return {
        "state_names": model.state_names,
        "state_units": model.state_units,
        "measurement_names": model.measurement_names,
    }


def _schedule(summary: Summary, architecture: Architecture) -> dict[str, Any]:
    return {
        "interval_cycles": summary.interval_cycles,
        "latency_cycles": summary.latency_cycles,
        "channels": summary.channels,
        "lanes": architecture.lanes,
        "streams": architecture.streams.value,
        "units": summary.units,
        "recurrence_bound_cycles": summary.recurrence_bound_cycles,
        "least_interval_cycles": summary.least_interval_cycles,
        "least_latency_cycles": summary.least_latency_cycles,
        "operator_bound_cycles": summary.operator_bound_cycles,
        "turns": summary.turns,
        "buses": summary.buses,
        "distance_cycles": summary.distance_cycles,
        "shallower": summary.shallower,
        "loop": summary.loop,
        "multiplier_blocks": summary.multiplier_blocks,
        "register_bits": summary.register_bits,
        "operator_register_bits": summary.operator_register_bits,
        "memory_bits": summary.memory_bits,
    }


def _estimates(record: Record, summary: Summary) -> dict[str, Any]:
    """What the schedule expects of the device, before any tool has seen the design."""
    target, architecture = record.hardware.design.target, record.hardware.design.architecture
    clock = 1000 / summary.period_ns if summary.period_ns else math.nan
    return {
        "period_ns": summary.period_ns,
        "pipelined_period_ns": summary.pipelined_period_ns,
        "fmax_mhz": clock,
        **_rates(summary, architecture, clock),
        "delays_measured_with": device(target.device, target.grade).measured_with,
    }


def _rates(summary: Summary, architecture: Architecture, fmax_mhz: float) -> dict[str, float]:
    fed = architecture.lanes_fed(summary.interval_cycles)
    return {
        "latency_ns": summary.latency_cycles * 1000 / fmax_mhz,
        "update_interval_ns": summary.interval_cycles * 1000 / fmax_mhz,
        "updates_per_second": fmax_mhz * 1e6 * fed / summary.interval_cycles,
    }


def _numerics(record: Record) -> dict[str, Any]:
    numbers, simulation = record.hardware.numbers, record.simulation
    rows = formats(numbers.typed, simulation.trace if simulation else None, record.proof)
    common = {
        "scaling": {
            key: getattr(numbers.scaling, key) for key in ("state", "measurement", "control", "covariance")
        },
        "formats": rows,
    }
    if isinstance(numbers.typed, FloatGraph):
        return {"kind": "float", **_floating(numbers.typed), **common}
    design, specification = record.hardware.design, record.hardware.design.fixed_point
    for row in rows:
        row["range_by"] = basis(row, specification, design.model)
    return {
        "kind": "fixed",
        "proofs": None if record.proof is None else proofs(numbers.typed, record.proof),
        "rounding": specification.rounding.value,
        "overflow": specification.overflow.value,
        "division": {"method": type(numbers.typed.division).__name__, **asdict(numbers.typed.division)},
        **common,
    }


def _floating(typed: FloatGraph) -> dict[str, Any]:
    form = typed.form
    return {
        "exponent": form.exponent,
        "mantissa": form.mantissa,
        "rounding": form.rounding.value,
        "subnormals": form.subnormals,
        "fused": len(typed.fused),
    }


def _accuracy(record: Record) -> dict[str, Any]:
    model, simulation = record.hardware.design.model, record.simulation
    if simulation is None:
        return no_accuracy(model) | {"nis_mean": None}
    return errors(model, simulation) | _nis(record, simulation) | _overflows(record, simulation)


def no_accuracy(model: Model) -> dict[str, Any]:
    """What there is to say of a build without data."""
    unknown: list[None] = [None] * model.n
    return {
        "steps": 0,
        "tracks": 0,
        "rmse_reference": unknown,
        "rmse_bitexact": unknown,
        "rmse_bitexact_to_reference": unknown,
        "saturations": None,
        "not_measured": "the build had no data: see --data",
    }


def errors(model: Model, simulation: SideBySide) -> dict[str, Any]:
    """How far the estimates of a simulation are from truth and float reference."""
    return {
        "steps": int(simulation.valid.sum()),
        "tracks": len(simulation.plots.tracks),
        "rmse_reference": against_truth(simulation, simulation.reference.x),
        "rmse_bitexact": against_truth(simulation, simulation.exact.x),
        "rmse_bitexact_to_reference": rmse(simulation.exact.x, simulation.reference.x),
        "differencing": _differencing(model, simulation),
    }


def _differencing(model: Model, simulation: SideBySide) -> list[dict[str, Any]]:
    return [
        {
            **asdict(one),
            "state": model.state_names[one.state],
            "of": model.state_names[one.of],
        }
        for one in differencing(model, simulation)
    ]


def _nis(record: Record, simulation: Simulation) -> dict[str, Any]:
    used = updated(simulation, record.hardware.design.model.initial.before_update)
    exact = mean_nis(simulation.exact.nis, used)
    return {
        "nis_mean": exact.mean,
        "nis_mean_reference": mean_nis(simulation.reference.nis, used).mean,
        "nis_band_95": [exact.low, exact.high],
        "nis_samples": exact.samples,
        "nis_inside": nis_inside(simulation.exact.nis, used),
    }


def _overflows(record: Record, simulation: Simulation) -> dict[str, Any]:
    found = overflows(record.hardware.numbers.typed, simulation.trace)
    return {
        "saturations": simulation.saturations,
        "saturations_unused": sum(one["unused"] for one in found),
        "inputs_clipped": simulation.stimulus.clipped,
        "saturations_by_signal": found,
    }


def _implementation(record: Record, summary: Summary) -> dict[str, Any]:
    """The best placement, and every one that was tried; nothing but the device where none was."""
    target, architecture = record.hardware.design.target, record.hardware.design.architecture
    target_named = {"device": target.device, "grade": target.grade, "asked_mhz": architecture.clock_mhz}
    if record.implemented is None:
        return {**target_named, **not_placed(), **dict.fromkeys(_rates(summary, architecture, 1.0))}
    best = record.implemented.best
    return {
        **target_named,
        **placed(record.implemented.placements),
        **_rates(summary, architecture, best.fmax_mhz),
        "closure": record.closure and asdict(record.closure),
    }


def placed(placements: Sequence[Implementation]) -> dict[str, Any]:
    """The best placement, which comes first, and every one that was tried."""
    best = placements[0]
    return {
        "tool": best.tool,
        **_figures(best),
        "seed": best.seed,
        "critical_path": [asdict(hop) for hop in best.critical_path],
        "placements": [
            {"seed": one.seed, **_figures(one)} for one in sorted(placements, key=lambda one: one.seed)
        ],
    }


def not_placed() -> dict[str, Any]:
    """What stands in place of a placement where there was none."""
    return {"tool": None, **dict.fromkeys(_FIGURES), "seed": None, "placements": [], "closure": None}


def _figures(placed: Implementation) -> dict[str, Any]:
    return {name: getattr(placed, name) for name in _FIGURES}


def _seconds(record: Record) -> dict[str, Any]:
    return {
        **dict.fromkeys(_STAGES),
        **record.all_seconds,
        "place_and_route_by_seed": _by_seed(record.implemented),
    }


def _by_seed(implemented: Implemented | None) -> dict[str, float]:
    placements = implemented.placements if implemented else ()
    return {str(one.seed): one.seconds for one in sorted(placements, key=lambda one: one.seed)}
