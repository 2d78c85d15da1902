"""``estimates.csv``: the float reference and the bit-exact estimates of a simulation side by side."""

import csv
import io
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.model import Model
from kalmanhdl.simulate.side_by_side import SideBySide

Array = NDArray[np.float64]


def estimates_csv(model: Model, simulation: SideBySide) -> str:
    """The table: one row for each row of data, by track and step; cells are empty before a track starts.

    Columns: ``track``, ``step``, for each state ``reference_``, ``exact_``, ``reference_var_`` and
    ``exact_var_`` and its name, and the ``nis`` of the hardware. Numbers read back without loss.
    """
    active = simulation.plots.active.T
    track, step = np.nonzero(active)
    labels = [_cell(name) for name in simulation.plots.tracks]
    columns: list[list[str]] = [[labels[k] for k in track.tolist()], list(map(str, step.tolist()))]
    names = ["track", "step"]
    for name, values in _columns(model, simulation):
        names.append(_cell(name))
        columns.append([repr(v) if v == v else "" for v in values.T[active].tolist()])
    rows = map(",".join, zip(*columns, strict=True))
    return "\n".join([",".join(names), *rows]) + "\n"


def _columns(model: Model, simulation: SideBySide) -> Iterator[tuple[str, Array]]:
    both = (("reference", simulation.reference), ("exact", simulation.exact))
    for i, state in enumerate(model.state_names):
        yield from ((f"{name}_{state}", found.x[..., i]) for name, found in both)
        yield from ((f"{name}_var_{state}", found.P[..., i, i]) for name, found in both)
    yield "nis", simulation.exact.nis


def _cell(text: str) -> str:
    line = io.StringIO()
    # A writer quotes line breaks of either kind only where its own lines end with both.
    csv.writer(line, lineterminator="\r\n").writerow([text])
    return line.getvalue().removesuffix("\r\n")
