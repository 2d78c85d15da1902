"""The papers whose experiments can be run again, by name."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from kalmanhdl.errors import DesignError
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.validation import nearest, shown

PAPERS = ("bhatia2012", "kumar2014", "lee1997", "liu2007", "wu2012")
# Those whose architectures are built beside ours, with their tables of hardware; of the others the experiment
# itself is hardware.
_HARDWARE = {
    "kumar2014": ("kumar2014_hardware",),
    "liu2007": ("liu2007_hardware", "liu2007_areas", "liu2007_processor"),
    "wu2012": ("wu2012_hardware",),
}


def reproduce(paper: str, progress: Progress = silent) -> Reproduction:
    """Run the experiment of a paper. Raises DesignError for a paper that is not among ``PAPERS``."""
    if paper not in PAPERS:
        raise DesignError(f"{shown(paper)} is no paper with an experiment here: {nearest(paper, PAPERS)}")
    return _run(paper, progress)


def hardware(paper: str, progress: Progress = silent) -> tuple[Reproduction, ...]:
    """The tables of a paper's architectures and ours, synthesised, placed and routed; none where it has none.

    Takes minutes for each of them. Raises as ``pipeline.implement`` does.
    """
    return tuple(_run(module, progress) for module in _HARDWARE.get(paper, ()))


def _run(module: str, progress: Progress) -> Reproduction:
    # Each has its figures, whatever they are, and one form in which it hands them on.
    found = import_module(f"kalmanhdl.reproduce.{module}")
    figures: Callable[[Progress], Any] = found.figures
    handed: Callable[[Any], Reproduction] = found.reproduction
    return handed(figures(progress))
