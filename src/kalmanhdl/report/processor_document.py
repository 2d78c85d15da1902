"""A build of a processor's program as the dictionary that ``report.json`` holds."""

from dataclasses import asdict
from typing import Any

import numpy as np

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.processor.build import Built
from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION, Core
from kalmanhdl.processor.fit import Fitted
from kalmanhdl.processor.follow import Followed
from kalmanhdl.report.document import SCHEMA, errors, named, no_accuracy, not_placed, placed, plain


def processor_document(built: Built) -> dict[str, Any]:
    """Everything of a build in plain values; what is the same in other builds has the same key."""
    fit, step = built.fit, built.step
    model = fit.given
    found = {
        "design": fit.design.name,
        "schema": SCHEMA,
        "architecture": "processor",
        "model": {"states": model.n, "measurements": model.m, "controls": model.p, **named(model)},
        "algorithm": fit.design.algorithm.kind,
        "core": _core(fit.core),
        "program": {
            "words": len(fit.program.words),
            "matrices": len(fit.program.matrices),
            "instructions_per_step": step.instructions,
            "clocks_per_step": step.clocks,
            "clocks_per_step_at_eight_an_instruction": CLOCKS_PER_INSTRUCTION * step.instructions,
        },
        "step": [asdict(row) for row in step.rows],
        "units": _units(fit),
        "accuracy": no_accuracy(model) if built.followed is None else _accuracy(fit, built.followed),
        "verification": [asdict(one) | {"mismatches": 0} for one in built.checked],
        "implementation": _implementation(built),
        "seconds": dict(built.seconds),
    }
    return plain(found)  # type: ignore[no-any-return]


def _core(core: Core) -> dict[str, Any]:
    return {
        "size": core.size,
        **_format(core),
        "multipliers": core.multipliers,
        "pipelined": core.pipelined,
        "matrices": core.matrices,
        "program_words": core.program_words,
    }


def _format(core: Core) -> dict[str, Any]:
    form = core.form
    if isinstance(form, Fixed):
        modes = {"rounding": core.rounding.value, "overflow": core.overflow.value}
        return {"numbers": "fixed", "width": form.width, "fraction": form.fraction, **modes}
    return {
        "numbers": "float",
        "width": form.width,
        "exponent": form.exponent,
        "mantissa": form.mantissa,
        "rounding": form.rounding.value,
        "subnormals": form.subnormals,
    }


def _units(fit: Fitted) -> dict[str, Any]:
    """What one unit of a number that goes in or comes out is, in the units of the model."""
    scaling = fit.scaling
    return {
        "x": scaling.state,
        "P": np.diag(scaling.covariances()),
        "z": scaling.measurement,
        "u": scaling.control,
    }


def last_bits(fit: Fitted) -> dict[str, float]:
    """The last bit of each state that is put out, in the model's units; that of floats varies."""
    if fit.core.floating:
        return {}
    resolution = float(fit.core.fixed_form.resolution)
    return {f"x[{i}]": resolution * float(unit) for i, unit in enumerate(fit.scaling.state)}


def _accuracy(fit: Fitted, followed: Followed) -> dict[str, Any]:
    return {
        **errors(fit.given, followed),
        "off_reference": off_reference(followed),
        "saturations": followed.saturations,
        "inputs_clipped": followed.clipped,
    }


def off_reference(followed: Followed) -> Any:
    """How far the estimates are from those in double precision at most, in the model's units. Shape (n,)."""
    off = np.abs(followed.exact.x - followed.reference.x)[followed.valid]
    return off.max(axis=0, initial=0.0)


def _implementation(built: Built) -> dict[str, Any]:
    target = built.fit.design.target
    found = {"device": target.device, "grade": target.grade, "asked_mhz": None, "closure": None}
    if not built.placed:
        return {**found, **not_placed(), "updates_per_second": None}
    best = built.placed[0]
    rate = best.fmax_mhz * 1e6 / built.step.clocks
    return {**found, **placed(built.placed), "updates_per_second": rate}
