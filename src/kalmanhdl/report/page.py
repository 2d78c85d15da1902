"""``report.html``: one file with its figures and everything they need, for a browser without a network."""

import re
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np
from bokeh.embed import components
from bokeh.resources import Resources
from jinja2 import Environment, PackageLoader, StrictUndefined

from kalmanhdl import __version__
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.report import figures
from kalmanhdl.report.accuracy import featured
from kalmanhdl.report.formats import resolutions
from kalmanhdl.report.geometry import Kind, plane, with_unit
from kalmanhdl.report.lanes import lanes
from kalmanhdl.report.record import Record
from kalmanhdl.report.tiles import tiles
from kalmanhdl.report.wording import number, percent, prefixed
from kalmanhdl.simulate.side_by_side import SideBySide

_RANDOM = re.compile(r"[0-9a-zA-Z]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}")
# Beyond this many states a page of one figure for each serves nobody.
_SHOWN = 12


def page(record: Record, document: dict[str, Any]) -> str:
    """The page of a build; ``document`` is its ``report.document``."""
    model = record.hardware.design.model
    drawn = {"schedule": figures.bars_figure(lanes(record.summary.rows), "operation")}
    if record.simulation is not None:
        bits = resolutions(record.hardware.numbers.typed)
        drawn |= of_data(model, record.simulation, bits)
    return rendered(
        "page.html.j2",
        model,
        record.simulation,
        drawn,
        document | {"tiles": tiles(document), "quantities": _quantities(model)},
    )


def rendered(
    template: str,
    model: Model,
    simulation: SideBySide | None,
    drawn: dict[str, object],
    more: Mapping[str, Any],
) -> str:
    """A page of figures by name, with what the words around those of data need; ``more`` is the rest."""
    script, divisions = _steady(*components(drawn))
    resources = Resources(mode="inline", components=["bokeh"])
    environment = Environment(
        loader=PackageLoader("kalmanhdl.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "prefixed": prefixed, "percent": percent}
    return environment.get_template(template).render(
        **more,
        version=__version__,
        style=files(__package__).joinpath("page.css").read_text(),
        library=resources.render_js(),
        script=script,
        figures=divisions,
        captions=_captions(model, simulation),
        states=[s for s in range(model.n) if f"state{s}" in drawn],
        innovations=[j for j in range(model.m) if f"innovation{j}" in drawn],
    )


def _steady(script: str, divisions: dict[str, str]) -> tuple[str, dict[str, str]]:
    """The same with numbers for the random names that Bokeh gives, so that equal builds give equal pages."""
    names: dict[str, str] = {}

    def named(match: re.Match[str]) -> str:
        return names.setdefault(match.group(), f"figure-{len(names)}")

    return _RANDOM.sub(named, script), {key: _RANDOM.sub(named, text) for key, text in divisions.items()}


def of_data(model: Model, simulation: SideBySide, bits: Mapping[str, float]) -> dict[str, object]:
    """The figures of data by name; ``bits`` has the last bits of states, in their units, such as ``x[0]``."""
    shown = range(min(model.n, _SHOWN))
    drawn = {
        "track": figures.track_figure(model, simulation),
        "deviation": figures.deviation_figure(model, simulation),
    }
    # Gains follow from covariances where F and H are constant.
    drawn |= {"gain": figures.gain_figure(model, simulation)} if isinstance(model, LinearModel) else {}
    tracks = figures.tracks_figure(model, simulation)
    drawn |= {} if tracks is None else {"tracks": tracks}
    drawn |= {f"state{i}": figures.state_figure(model, simulation, i) for i in shown}
    drawn |= {
        f"error{i}": figures.quantisation_figure(model, simulation, i, bits.get(f"x[{i}]")) for i in shown
    }
    # The processor keeps its innovations to itself.
    told = [j for j in range(min(model.m, _SHOWN)) if np.isfinite(simulation.exact.innovation[..., j]).any()]
    return drawn | {f"innovation{j}": figures.innovation_figure(model, simulation, j) for j in told}


def _quantities(model: Model) -> dict[str, str]:
    """What stands behind the letters of inputs, states and outputs."""
    named = enumerate(zip(model.state_names, model.state_units, strict=True))
    names = {f"x[{i}]": with_unit(name, unit) for i, (name, unit) in named}
    for i, first in enumerate(model.state_names):
        names |= {
            f"P[{i},{j}]": f"covariance of {first} and {model.state_names[j]}" for j in range(i + 1, model.n)
        }
        names[f"P[{i},{i}]"] = f"variance of {first}"
    names |= {f"z[{j}]": name for j, name in enumerate(model.measurement_names)}
    names |= {f"innovation[{j}]": f"innovation of {name}" for j, name in enumerate(model.measurement_names)}
    names |= {f"u[{k}]": name for k, name in enumerate(model.control_names)}
    return {signal: name.replace("_", " ") for signal, name in names.items()}


def _captions(model: Model, simulation: SideBySide | None) -> dict[str, Any]:
    """What the words around the figures need to know of the data."""
    if simulation is None:
        return {}
    tracks = simulation.plots.tracks
    return {
        "track": tracks[featured(simulation)],
        "tracks": len(tracks),
        "tracks_drawn": min(len(tracks), figures.TRACKS),
        "polar": plane(model).kind is Kind.POLAR,
        "plane": plane(model).kind is not Kind.TIME,
        "plots": bool(plane(model).measurements),
        "truth": simulation.plots.truth is not None,
        "inside": [figures.inside_band(model, simulation, j) for j in range(model.m)]
        if isinstance(model, LinearModel)
        else None,
    }
