"""The number formats of a design, signal by signal, and how much of them was used."""

from typing import Any

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.operations import Input, Quantise, Select, State
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.signals import signal_of
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.proof.prove import Proof
from kalmanhdl.simulate.engine import Trace


def formats(
    typed: TypedGraph | FloatGraph, trace: Trace | None, proof: Proof | None = None
) -> list[dict[str, Any]]:
    """A row for each input, state, output, and value that is rounded on the way.

    In floating point, where all have one format, there are no rows.

    ``unit`` is the real value of one unit of the hardware, so that the last bit is ``resolution`` in the
    model's units; both are None for values on the way. ``used_bits`` is what the data of a
    simulation needed of ``width``. ``proven`` tells that no input within its format makes the value leave
    its own, by interval analysis. ``overflow`` is then "never", else "flagged", and of an input "clamped".
    With a ``proof`` it may be "proven" for tracks that keep its contract, by what is in ``proof``, or
    "reachable" by such tracks; and ``least`` and ``greatest`` are proven limits, in the model's units where
    there is a unit.
    """
    if isinstance(typed, FloatGraph):
        return []
    rows: list[dict[str, Any]] = []
    known: set[int] = set()
    for role, signals in _named(typed).items():
        for name, index in signals:
            if typed.formats[index] is not None and (role, index) not in {("output", k) for k in known}:
                rows.append(_row(typed, trace, role, name, index) | _proofs(typed, proof, role, name, index))
                known.add(index)
    for index, operation in enumerate(typed.graph.operations):
        if isinstance(operation, Quantise) and index not in known:
            name = signal_of(typed.graph.origins[index]).name
            rows.append(_row(typed, trace, "inner", name, index) | _proofs(typed, proof, "inner", "", index))
    return rows


def basis(row: dict[str, Any], specification: FixedSpecification, model: Model) -> str:
    """What the bits above the binary point of a row of ``formats`` rest on."""
    if isinstance(specification.form(row["class"], row["signal"]), Fixed):
        return "the design"
    if row["exact"]:
        return "its operands"
    measured = model.measurement_range is not None and row["class"] == "measurement"
    inputs = [f"u[{k}]" for k in range(model.p - len(model.inputs), model.p)]
    declared = measured or (row["role"] == "input" and row["signal"] in inputs)
    return "declared range" if declared else "simulated tracks"


def proofs(typed: TypedGraph, proof: Proof) -> dict[str, Any]:
    """What a proof holds for, how many values it speaks of, and how far it came, part by part."""
    return {
        "contract": {
            "inputs": "within their declared ranges, or else within their formats",
            "initialise": proof.contract.points,
            "misses_in_a_row": proof.contract.coast,
        },
        "proven": len(proof.proven),
        "reachable": len(proof.reached),
        "flagged": len(typed.violations) - len(proof.proven) - len(proof.reached),
        "parts": [
            {
                "states": part.states,
                "covariances": part.covariances,
                "covariances_unsettled": part.unsettled,
                "states_unbounded": part.unbounded,
            }
            for part in proof.parts
        ],
    }


def overflows(typed: TypedGraph | FloatGraph, trace: Trace) -> list[dict[str, Any]]:
    """The values that left their formats: in steps that used them, and in steps that chose another."""
    mattered = trace.violations
    counts = mattered if isinstance(typed, FloatGraph) else trace.saturations
    return [
        {
            "signal": signal_of(typed.graph.origins[index]).name,
            "origin": typed.graph.origins[index],
            "saturations": mattered.get(index, 0),
            "unused": count - mattered.get(index, 0),
        }
        for index, count in sorted(counts.items())
        if count
    ]


def resolutions(typed: TypedGraph | FloatGraph) -> dict[str, float]:
    """The last bit of every input, state and output, in the model's units; none in floating point."""
    if isinstance(typed, FloatGraph):
        return {}
    named = (pair for signals in _named(typed).values() for pair in signals)
    return {
        name: float(form.resolution) * typed.scales[name]
        for name, index in named
        if (form := typed.formats[index]) is not None and name in typed.scales
    }


def _named(typed: TypedGraph) -> dict[str, list[tuple[str, int]]]:
    operations = typed.graph.operations
    return {
        "input": [(o.name, k) for k, o in enumerate(operations) if isinstance(o, Input)],
        "state": list(typed.graph.states),
        "output": list(typed.graph.outputs),
    }


def _row(typed: TypedGraph, trace: Trace | None, role: str, name: str, index: int) -> dict[str, Any]:
    form = typed.formats[index]
    assert form is not None
    unit = None if role == "inner" else typed.scales.get(name)
    seen = trace.extremes.get(index) if trace else None
    used = max(seen.high.bit_length(), (~seen.low if seen.low < 0 else seen.low).bit_length()) if seen else 0
    return {
        "signal": name,
        "role": role,
        "class": signal_of(typed.graph.origins[index]).signal_class,
        "origin": typed.graph.origins[index],
        "width": form.width,
        "fraction": form.fraction,
        "signed": form.signed,
        "unit": unit,
        "resolution": None if unit is None else float(form.resolution) * unit,
        "lowest": None if unit is None else float(form.real(form.lowest)) * unit,
        "highest": None if unit is None else float(form.real(form.highest)) * unit,
        "exact": not isinstance(typed.graph.operations[index], Input | State | Quantise | Select),
        "proven": not _can_leave(typed, index),
        "used_bits": used + form.signed if seen else None,
    }


def _proofs(typed: TypedGraph, proof: Proof | None, role: str, name: str, index: int) -> dict[str, Any]:
    """What is known of a value's limits, with limits in its unit, or else in that of the hardware."""
    chosen = _violations(typed, index)
    if proof is None:
        return {"overflow": "clamped" if role == "input" else "flagged" if chosen else "never"}
    unproven = [k for k in chosen if k not in proof.proven]
    bound, form = proof.bounds.get(index), typed.formats[index]
    assert form is not None
    overflow = "proven" if chosen else "never"
    if unproven:
        overflow = "reachable" if any(k in proof.reached for k in unproven) else "flagged"
    unit = float(form.resolution) * typed.scales.get(name, 1.0)
    return {
        "overflow": "clamped" if role == "input" else overflow,
        "proof": ", ".join(sorted({proof.proven[k] for k in chosen})) if not unproven else "",
        "least": None if bound is None else bound.low * unit,
        "greatest": None if bound is None else bound.high * unit,
    }


def _violations(typed: TypedGraph, index: int) -> list[int]:
    """The violations of a value, or of those that it is chosen from."""
    operation = typed.graph.operations[index]
    if isinstance(operation, Select):
        return [*_violations(typed, operation.a), *_violations(typed, operation.b)]
    return [v.quantise for v in typed.violations if v.quantise == index]


def _can_leave(typed: TypedGraph, index: int) -> bool:
    """Whether a value, or one that it is chosen from, is among those that can leave their format."""
    return bool(_violations(typed, index))
