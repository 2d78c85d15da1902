"""Whether a build's report.json has its keys, no mismatch, and figures that can be."""

import csv
import json
import math
import sys
from pathlib import Path

KEYS = {
    "": "design schema model algorithm operations schedule accuracy verification implementation seconds",
    "model": "states measurements components",
    "operations": "add subtract multiply constant_multiply divide reciprocal square_root",
    "schedule": "interval_cycles latency_cycles channels units recurrence_bound_cycles",
    "accuracy": "steps rmse_reference rmse_bitexact nis_mean saturations",
    "implementation": "device tool fmax_mhz luts ffs multipliers block_rams latency_ns updates_per_second",
    "seconds": "trace schedule verify synthesise place_and_route",
}
FILES = ("design.toml", "graph.txt", "schedule.txt", "report.html", "estimates.csv")


def problems(folder: Path) -> list[str]:
    """Everything that is wrong with a demo build, in words."""
    report = json.loads((folder / "report.json").read_text())
    found = [f"no file {name}" for name in (*FILES, f"{report['design']}.v") if not (folder / name).is_file()]
    for part_name, keys in KEYS.items():
        part = report[part_name] if part_name else report
        found += [f"no key {part_name}.{key}" for key in keys.split() if key not in part]
    return found or figures(report) + table(folder)


def figures(report: dict) -> list[str]:
    """What the demo must reach."""
    verified, accuracy, made = report["verification"], report["accuracy"], report["implementation"]
    rules = {
        "verification ran": bool(verified) and sum(one["steps"] for one in verified) >= 100_000,
        "no mismatch": all(one["mismatches"] == 0 for one in verified),
        "two decoupled components": report["model"]["components"] == 2,
        "at most 8 multiplications": report["operations"]["multiply"] <= 8,
        "at most 2 reciprocals": report["operations"]["reciprocal"] + report["operations"]["divide"] <= 2,
        "at most 10 multipliers": 0 < made["multipliers"] <= 10,
        "placed at 100 MHz or more": 100 < made["fmax_mhz"] < 1000,
        "rates follow from the clock": math.isclose(
            made["updates_per_second"],
            made["fmax_mhz"] * 1e6 / report["schedule"]["interval_cycles"],
            rel_tol=1e-6,
        ),
        "hardware within 1 % of the reference": all(
            exact <= 1.01 * reference
            for exact, reference in zip(accuracy["rmse_bitexact"], accuracy["rmse_reference"], strict=True)
        ),
        "rates much better than two-point differencing": all(
            one["rmse_bitexact"] < 0.6 * one["rmse"] for one in accuracy["differencing"]
        ),
    }
    return [f"not so: {rule}" for rule, holds in rules.items() if not holds]


def table(folder: Path) -> list[str]:
    """Whether estimates.csv can be read back."""
    with (folder / "estimates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [] if rows and {"track", "step", "nis"} <= set(rows[0]) else ["estimates.csv has no rows"]


if __name__ == "__main__":
    wrong = problems(Path(sys.argv[1]))
    print("\n".join(wrong) or "report.json: as it must be")
    sys.exit(bool(wrong))
