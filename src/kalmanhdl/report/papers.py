"""The figures of the papers, and a build's own beside them."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure of a paper; ``measure`` is the path of the same figure in the report, with dots.

    ``note`` says what the two have not in common.
    """

    what: str
    unit: str
    value: float
    measure: str
    source: str
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Paper:
    """A paper, what it built its filter on, and its figures."""

    name: str
    title: str
    hardware: str
    figures: tuple[Figure, ...]


def paper_of(design: str) -> Paper | None:
    """The paper that a design is named after: its name, or its name and more behind an underscore."""
    return next((p for p in papers() if design == p.name or design.startswith(f"{p.name}_")), None)


def beside(paper: Paper, document: dict[str, Any]) -> list[dict[str, Any]]:
    """Every figure of a paper beside the report's own; None where the report has none."""
    return [
        {
            "what": figure.what,
            "unit": figure.unit,
            "paper": figure.value,
            "here": _at(document, figure.measure),
            "measure": figure.measure,
            "source": figure.source,
            "note": figure.note,
        }
        for figure in paper.figures
    ]


@cache
def papers() -> tuple[Paper, ...]:
    """All papers of which figures are known."""
    facts = tomllib.loads(files(__package__).joinpath("papers.toml").read_text())
    return tuple(
        Paper(
            name=name,
            title=fact["title"],
            hardware=fact["hardware"],
            figures=tuple(Figure(**figure) for figure in fact["figures"]),
        )
        for name, fact in facts.items()
    )


def _at(document: dict[str, Any], path: str) -> Any:
    found: Any = document
    for key in path.split("."):
        found = found.get(key) if isinstance(found, dict) else None
    return found
