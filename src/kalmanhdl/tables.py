"""What the commands print: short tables, as text."""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from json import dumps
from typing import Any

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.closure.rounds import Closure
from kalmanhdl.design import Architecture, Design, Streams
from kalmanhdl.explore.evaluator import Objective, Point
from kalmanhdl.explore.monte_carlo import MonteCarlo
from kalmanhdl.explore.search import Found
from kalmanhdl.explore.sweep import Row, as_records
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.floating import FloatGraph, FloatNumbers
from kalmanhdl.numerics.integers import Numbers
from kalmanhdl.pipeline import Implemented
from kalmanhdl.proof.prove import Proof
from kalmanhdl.report.accuracy import against_truth, differencing, mean_nis, nis_inside, updated
from kalmanhdl.report.document import document, operation_counts
from kalmanhdl.report.formats import basis, formats
from kalmanhdl.report.record import Record
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.summary import Summary, summarise
from kalmanhdl.simulate.metrics import rmse
from kalmanhdl.simulate.side_by_side import SideBySide, Simulation
from kalmanhdl.toolchain.area import AreaFigures
from kalmanhdl.toolchain.nextpnr import Implementation
from kalmanhdl.verify.compare import Verification

_BAR_COLUMNS = 64
_FRONT_ROWS = 12


def build_table(record: Record) -> str:
    """The figures of a build, a line a stage."""
    hardware, facts = record.hardware, document(record)
    plan, architecture = hardware.plan, hardware.design.architecture
    rows: list[Sequence[str]] = [
        ("design", f"{hardware.design.name}, {facts['algorithm']}, {_model(facts['model'])}"),
        ("operations", _counted(facts["operations"])),
        ("schedule", _schedule(plan)),
        *_lanes(architecture),
    ]
    if record.simulation is not None:
        accuracy = facts["accuracy"]
        rows.append(("data", f"{accuracy['steps']} estimates of {accuracy['tracks']} tracks"))
        rows += [("", line) for line in accuracy_table(hardware.design.model, record.simulation).splitlines()]
    else:
        rows.append(("data", "none: errors and normalised innovations squared were not measured, see --data"))
    rows.append(("verification", _verified(record.verifications)))
    if record.implemented is not None:
        rows.append(("implementation", _placed(plan, architecture, record.implemented)))
        rows += _clock(architecture, record.implemented, record.closure)
    rows += [("synthesis", f"{one.family_name}: {_cells(one)}") for one in record.areas]
    return aligned(rows)


def _model(facts: dict[str, Any]) -> str:
    parts = facts["components"]
    return (
        f"{facts['states']} states in {parts} {'part' if parts == 1 else 'parts'}, "
        f"{facts['measurements']} measured"
    )


def _counted(counts: dict[str, int]) -> str:
    named = ((name.replace("_", " "), count) for name, count in counts.items() if count)
    return ", ".join(f"{count} {name}" for name, count in named if name != "divisions and reciprocals")


def _schedule(plan: Plan) -> str:
    parts = [
        f"a step every {_clocks(plan.interval)}",
        "1 track" if plan.channels == 1 else f"{plan.channels} tracks",
        f"latency {_clocks(plan.latency)}",
        f"recurrence bound {_clocks(plan.recurrence_bound)}",
        *(["pipeline made shallower"] if plan.shallower else []),
    ]
    return ", ".join(parts)


def _lanes(architecture: Architecture) -> list[Sequence[str]]:
    """What is told of several lanes; the lines of the schedule are those of one."""
    if architecture.lanes == 1:
        return []
    tracks = architecture.lanes * architecture.channels
    streams = "streams of their own" if architecture.streams is Streams.LANE else "one stream"
    return [("lanes", f"{architecture.lanes} of these side by side with {streams}, {tracks} tracks")]


def _clocks(count: int) -> str:
    return f"{count} clock" if count == 1 else f"{count} clocks"


def _verified(found: Sequence[Verification]) -> str:
    if not found:
        return "was not run"
    return f"{sum(v.steps for v in found)} steps, {sum(v.mismatches for v in found)} mismatches"


def _placed(plan: Plan, architecture: Architecture, implemented: Implemented) -> str:
    best = implemented.best
    rate = best.fmax_mhz * architecture.lanes_fed(plan.interval) / plan.interval
    speed = f"{best.fmax_mhz:.1f} MHz (seed {best.seed}), {rate:.1f} M updates/s"
    return f"{best.device} grade {best.grade}: {speed}, {_cells(best)}"


def _clock(
    architecture: Architecture, implemented: Implemented, closure: Closure | None
) -> list[Sequence[str]]:
    """The clock that was reached beside the one asked for, if any, and a line for each round."""
    asked = architecture.clock_mhz
    if asked is None:
        return []
    reached = implemented.best.fmax_mhz
    met = "reached" if reached >= asked else "missed"
    rows: list[Sequence[str]] = [("clock", f"{asked:g} MHz asked for, {reached:.1f} found: {met}")]
    if closure is None:
        return rows
    for number, one in enumerate(closure.rounds):
        where = ", ".join(f"{part.kind} ({part.name})" for part in one.critical) or "no operator"
        kept = ", kept" if number == closure.kept else ""
        rows.append(
            (
                f"round {number + 1}",
                f"{one.change or 'as the table says'}: a step every {_clocks(one.interval_cycles)}, latency "
                f"{_clocks(one.latency_cycles)}, {one.reached_mhz:.1f} MHz, {one.step_ns:.1f} ns a step"
                f"{kept}; longest path: {where}",
            )
        )
    rows.append(("", f"no more rounds: {closure.stopped}"))
    return rows


def closure_table(architecture: Architecture, implemented: Implemented, closure: Closure | None) -> str:
    """The clock beside the one asked for, and every round that was scheduled and placed."""
    return aligned(_clock(architecture, implemented, closure))


def _cells(found: Implementation | AreaFigures) -> str:
    return (
        f"{found.luts} LUTs, {found.ffs} flip-flops, {found.multipliers} multipliers, "
        f"{found.block_rams} block RAMs"
    )


def accuracy_table(model: Model, simulation: Simulation) -> str:
    """As ``errors_table``, and counts of what did not fit its format."""
    counts = f"{simulation.saturations} saturations, {simulation.stimulus.clipped} inputs out of range"
    return f"{errors_table(model, simulation)}\n{counts}"


def errors_table(model: Model, simulation: SideBySide) -> str:
    """For each state the root mean square errors of float reference and engine, and between the two.

    Below it rates beside what two plots in succession say, and whether the innovations are as large as the
    model says.
    """
    between = rmse(simulation.exact.x, simulation.reference.x)
    columns = [("state", *model.state_names), ("unit", *(unit or "-" for unit in model.state_units))]
    if simulation.plots.truth is not None:
        reference = against_truth(simulation, simulation.reference.x)
        exact = against_truth(simulation, simulation.exact.x)
        columns += [("rmse float", *map(_figure, reference)), ("rmse hardware", *map(_figure, exact))]
    columns.append(("hardware to float", *map(_figure, between)))
    parts = [aligned(zip(*columns, strict=True)), _differenced(model, simulation), _nis(model, simulation)]
    return "\n".join(part for part in parts if part)


def _differenced(model: Model, simulation: SideBySide) -> str:
    """Rates beside two-point differencing of the plots, at the steps where there are two."""
    found = differencing(model, simulation)
    lines: list[Sequence[str]] = [("rate", "unit", "steps", "rmse of two plots", "float", "hardware")]
    for one in found:
        name, unit = model.state_names[one.state], model.state_units[one.state] or "-"
        errors = (one.rmse, one.rmse_reference, one.rmse_bitexact)
        lines.append((name, unit, str(one.samples), *map(_figure, errors)))
    return aligned(lines) if found else ""


def _nis(model: Model, simulation: SideBySide) -> str:
    """The mean NIS of float reference and hardware, and whether it lies in its band."""
    used = updated(simulation, model.initial.before_update)
    reference, exact = (mean_nis(each.nis, used) for each in (simulation.reference, simulation.exact))
    if not exact.samples:
        return ""
    verdict = "inside" if exact.consistent else "below" if exact.mean < exact.low else "above"
    return (
        f"NIS: mean {exact.mean:.3f} (float {reference.mean:.3f}) of {exact.samples} updates, {verdict} its "
        f"band of 95 %, {exact.low:.3f} to {exact.high:.3f}; {nis_inside(simulation.exact.nis, used):.1%} of "
        "updates below their limit of 95 %"
    )


def verification_table(found: Sequence[Verification]) -> str:
    """What was compared, a line a stimulus."""
    rows: list[Sequence[str]] = [
        ("simulator", "stimulus", "steps", "bits", "cycles", "cycles/s", "mismatches")
    ]
    for one in found:
        numbers = (one.steps, one.bits, one.cycles, round(one.cycles_per_second), one.mismatches)
        rows.append((one.simulator, one.stimulus, *map(str, numbers)))
    return aligned(rows)


def implementation_table(plan: Plan, architecture: Architecture, implemented: Implemented) -> str:
    """Every placement, the best first."""
    rows: list[Sequence[str]] = [
        ("seed", "MHz", "M updates/s", "ns a step", "LUTs", "flip-flops", "multipliers", "block RAMs")
    ]
    for one in implemented.placements:
        rate = one.fmax_mhz * architecture.lanes_fed(plan.interval) / plan.interval
        step = plan.latency * 1000 / one.fmax_mhz
        cells = (one.luts, one.ffs, one.multipliers, one.block_rams)
        rows.append((str(one.seed), f"{one.fmax_mhz:.2f}", f"{rate:.2f}", f"{step:.2f}", *map(str, cells)))
    best = implemented.best
    return f"{best.device} grade {best.grade}, {best.tool}\n{aligned(rows)}"


def reproduction_table(found: Reproduction) -> str:
    """A paper's figures and those of the run, and what they rest on."""
    notes = "\n".join(f"- {note}" for note in found.notes)
    return f"{found.title}\n\n{aligned([found.columns, *found.rows])}\n\n{notes}"


def design_tables(
    design: Design, numbers: Numbers | FloatNumbers, plan: Plan, proof: Proof | None = None
) -> str:
    """Operations, formats, bounds and schedule of a design, and what was proven of its formats."""
    summary = summarise(plan, design.target.part)
    needed, monitoring = operation_counts(numbers.graph)
    clock = 1000 / plan.period_ns if plan.period_ns else 0.0
    head = [
        ("design", f"{design.name}, {design.algorithm.kind}"),
        ("operations", _counted(needed)),
        ("", f"{_counted(monitoring) or 'none'} for innovation and NIS alone"),
        ("schedule", _schedule(plan)),
        *_lanes(design.architecture),
        ("bound set by", ", ".join(summary.loop) or "nothing"),
        ("clock", f"{plan.period_ns:.2f} ns ({clock:.0f} MHz) expected on {design.target.device}"),
        ("units", _counted(summary.units)),
        *_turns(summary),
        (
            "registers",
            f"{summary.register_bits} bits between, {summary.operator_register_bits} inside operators",
        ),
    ]
    proven = [] if proof is None else [_proof(proof)]
    return "\n\n".join((aligned(head), _formats(design, numbers, proof), *proven, _chart(summary)))


def _turns(summary: Summary) -> list[tuple[str, str]]:
    """The operators that are shared, and the interval beside the least that they and the loop allow."""
    if not summary.turns:
        return []
    shared = ", ".join(f"{count} {kind} on {summary.units[kind]}" for kind, count in summary.turns.items())
    shared += f", whose sums leave on {summary.buses} buses" if summary.buses > 1 else ""
    loop = -(-summary.recurrence_bound_cycles // summary.channels)
    interval = _beside_least(summary.interval_cycles, summary.least_interval_cycles)
    return [
        ("turns", shared),
        ("interval", f"{interval}; operators need {summary.operator_bound_cycles}, the loop {loop}"),
        ("latency", _beside_least(summary.latency_cycles, summary.least_latency_cycles)),
        ("memories", f"{summary.memory_bits} bits of operands that wait"),
    ]


def _beside_least(cycles: int, least: int) -> str:
    found = "the least there is" if cycles == least else f"no less than {least} was proven"
    return f"{_clocks(cycles)}, {found}"


def _float_format(typed: FloatGraph) -> str:
    """The format of a design in floating point."""
    form = typed.form
    normal, highest = form.real(1 << form.mantissa), form.real(form.highest)
    least = form.real(1) if form.subnormals else normal
    rows = [
        ("format", f"{form}, rounded {form.rounding.value.replace('_', ' ')}"),
        ("", f"from {_decimal(least)}, in full from {_decimal(normal)}, to {_decimal(highest)}"),
        ("fused", f"{len(typed.fused)} multiplications with the sum that uses them"),
    ]
    return aligned(rows)


def _decimal(value: Fraction) -> str:
    """A positive number in decimals, however large or small."""
    exponent = len(str(value.numerator)) - len(str(value.denominator))
    scaled = value / Fraction(10) ** exponent
    if scaled < 1:
        scaled, exponent = scaled * 10, exponent - 1
    return f"{float(scaled):.4g}e{exponent:+03d}"


def _formats(design: Design, numbers: Numbers | FloatNumbers, proof: Proof | None) -> str:
    """Formats, a line each: what their bits above the binary point rest on, and whether they always do."""
    if isinstance(numbers.typed, FloatGraph):
        return _float_format(numbers.typed)
    more = () if proof is None else ("proof", "least", "greatest")
    rows: list[Sequence[str]] = [
        ("signal", "role", "format", "last bit", "lowest", "highest", "range by", "overflow", *more)
    ]
    for row in formats(numbers.typed, None, proof):
        form = f"{'' if row['signed'] else 'u'}fixed({row['width']}, fraction={row['fraction']})"
        limits = (row["resolution"], row["lowest"], row["highest"])
        ends = (basis(row, design.fixed_point, design.model), row["overflow"])
        shown = ("" if v is None else _figure(v) for v in limits)
        found = [row.get(key) for key in more]
        said = ("" if v is None else v if isinstance(v, str) else _figure(v) for v in found)
        rows.append((row["signal"], row["role"], form, *shown, *ends, *said))
    return aligned(rows)


def _proof(proof: Proof) -> str:
    """What the proofs hold for, and how far they came, part by part."""
    contract = proof.contract
    rows = [
        ("proofs", f"hold for inputs in their declared ranges, {contract.points} initialise a start,"),
        ("", f"and at most {contract.coast} misses of a measurement in a row"),
    ]
    for part in proof.parts:
        count = part.covariances
        searched = f"{count} covariances are reachable" if count is not None else part.unsettled
        bounds = part.unbounded or "the states are bounded for every input"
        rows.append((", ".join(part.states[:4]), f"{searched}; {bounds}"))
    return aligned(rows)


def _chart(summary: Summary) -> str:
    """A bar for each operation over the cycles of a step."""
    wide = max(1, -(-summary.latency_cycles // _BAR_COLUMNS))
    rows = [("cycle", "operation", "for", "" if wide == 1 else f"one mark is {wide} cycles")]
    for row in sorted(summary.rows, key=lambda row: (row.start, row.end)):
        begin, end = row.start // wide, row.end // wide
        bar = "." * begin + "#" * (end - begin + 1)
        rows.append((str(row.start), row.kind.replace("_", " "), row.origin, bar))
    return aligned(rows)


def formats_table(found: Found, tolerance: float | None) -> str:
    """The chosen formats, a line a signal, what they cost and give, and what others would."""
    rows: list[Sequence[str]] = [("signal", "width", "format", "headroom")]
    for variable, width in zip(found.variables, found.widths.tolist(), strict=True):
        forms = variable.forms(found.program, width)
        form = f"{forms[0]}" if len(forms) == 1 else _fractions(forms) or "by its divisor"
        many = "" if variable.count == 1 else f", {variable.count} of them"
        headroom = f"+{variable.headroom}" if variable.headroom else ""
        rows.append((variable.name, str(width), form + many, headroom))
    return "\n\n".join((aligned(rows), aligned(_choice(found, tolerance)), aligned(_front(found))))


def _fractions(forms: Sequence[Fixed]) -> str:
    """The formats of a signal whose values at several places are of different size."""
    fractions = sorted({form.fraction for form in forms})
    return f"fraction {fractions[0]} to {fractions[-1]}, by place" if fractions else ""


def _choice(found: Found, tolerance: float | None) -> list[Sequence[str]]:
    chosen, uniform = found.point, found.uniform_point
    saved = 1 - chosen.bits / uniform.bits
    rows: list[Sequence[str]] = [
        ("total", f"{chosen.bits} bits, {saved:.0%} less than uniform words"),
        ("uniform", f"{found.uniform} bits a word, {uniform.bits} bits, {_use(uniform)}"),
    ]
    if found.objective is Objective.AREA:
        rows.append(("area", f"{chosen.cost:.0f} LUTs, uniform {uniform.cost:.0f}: an estimate"))
    if found.unseen is not None:
        seen = f"{chosen.error:+.2%} on the tracks of the search"
        rows.append(("error", f"{seen}, {found.unseen:+.2%} on others"))
    if found.unseen_data is not None:
        rows.append(("", f"{found.unseen_data:+.2%} on data not seen"))
    if tolerance is not None:
        rows.append(("tolerance", f"{tolerance:+.2%}"))
    if found.bands is not None:
        reference, exact = found.bands
        for name, a, b in (("NEES", reference.nees, exact.nees), ("NIS", reference.nis, exact.nis)):
            band = f"within {b.low:.4f} to {b.high:.4f}"
            rows.append((name, f"{b.mean:.4f} {band} on tracks not seen, float {a.mean:.4f}"))
    return [*rows, ("search", f"{found.candidates} candidates, 0 saturations on tracks not seen")]


def _front(found: Found) -> list[Sequence[str]]:
    """The best choices that were met, by cost."""
    area = found.objective is Objective.AREA
    rows: list[Sequence[str]] = [("LUTs" if area else "bits", "best found on the tracks of the search", "")]
    shown = found.front
    if len(shown) > _FRONT_ROWS:
        picked = {round(k * (len(shown) - 1) / (_FRONT_ROWS - 1)) for k in range(_FRONT_ROWS)}
        shown = tuple(p for k, p in enumerate(shown) if k in picked or p == found.point)
    for point in shown:
        rows.append((f"{point.cost:.0f}", _use(point), "chosen" if point == found.point else ""))
    return rows


def _use(point: Point) -> str:
    """How much of what is allowed a choice uses."""
    parts = [f"error {point.error:+.3%}"] if point.error == point.error else []
    if point.shift == point.shift:
        parts.append(f"NEES and NIS moved by {point.shift:.2f} of half a band")
    return ", ".join(parts)


def sweep_table(rows: Sequence[Row]) -> str:
    """Accuracy against word length, a line a word length and algorithm."""
    head = ("algorithm", "bits", "error beyond float", "squared error", "float", "")
    lines: list[Sequence[str]] = [head]
    for row in rows:
        squares = (_figure(row.squared_error), _figure(row.float_squared_error))
        lines.append((row.algorithm, str(row.width), f"{100 * row.excess:+.4g} %", *squares, row.broken))
    kinds = dict.fromkeys(row.algorithm for row in rows)
    ends = [f"{kind}: {_least([row for row in rows if row.algorithm == kind])}" for kind in kinds]
    return "\n".join((aligned(lines), "", *ends))


def _least(rows: Sequence[Row]) -> str:
    """From which word length on an algorithm does not break."""
    broken = [row for row in rows if row.broken]
    if not broken:
        return f"breaks at none of these word lengths, {rows[0].width} to {rows[-1].width} bits"
    last = broken[-1]
    return f"breaks at {last.width} bits and less: {last.broken}"


def sweep_text(rows: Sequence[Row], *, json: bool) -> str:
    """The rows of a sweep as JSON or CSV; numbers that are not finite are null or empty."""
    records = [
        {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in record.items()}
        for record in as_records(tuple(rows))
    ]
    if json:
        return dumps(records, indent=1) + "\n"
    text = io.StringIO()
    writer = csv.DictWriter(text, list(records[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue()


def consistency_table(model: Model, found: MonteCarlo) -> str:
    """NEES, NIS and autocorrelation of float reference and hardware, with their bands."""
    pair = (found.reference, found.exact)
    rows: list[Sequence[str]] = [("", "float", "hardware", "band of 95 %")]
    for name, values in (("NEES at the end", [t.nees for t in pair]), ("NIS", [t.nis for t in pair])):
        means = [f"{v.mean:.4f}{'' if v.consistent else ' outside'}" for v in values]
        rows.append((name, *means, f"{values[0].low:.4f} to {values[0].high:.4f}"))
    inside = [f"{t.nees_inside:.1%}" for t in pair]
    rows.append(("steps with NEES inside", *inside, "95 % expected"))
    for j, name in enumerate(model.measurement_names):
        found_both = [f"{t.autocorrelation[j]:+.4f}" for t in pair]
        rows.append((f"autocorrelation, {name}", *found_both, f"within {found.reference.limit[j]:.4f}"))
    for i, name in enumerate(model.state_names):
        rows.append((f"rmse, {name}", *(_figure(float(t.rmse[i])) for t in pair), ""))
    counts = f"{found.tracks} tracks of {found.steps} steps, {found.saturations} saturations"
    return f"{aligned(rows)}\n{counts}"


def _figure(value: float) -> str:
    return "-" if value != value else f"{value:.4g}"


def aligned(rows: Iterable[Sequence[str]]) -> str:
    """A table: cells of a column side by side."""
    table = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join(_lines(table, widths))


def _lines(table: list[list[str]], widths: list[int]) -> Iterator[str]:
    for row in table:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
