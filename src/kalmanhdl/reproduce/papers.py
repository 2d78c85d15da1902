"""The papers whose experiments can be run again, by name."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from kalmanhdl.errors import DesignError
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.validation import nearest, shown

PAPERS = ("bhatia2012", "kumar2014", "lee1997", "liu2007", "wu2012")


def reproduce(paper: str, progress: Progress = silent) -> Reproduction:
    """Run the experiment of a paper. Raises DesignError for a paper that is not among ``PAPERS``."""
    if paper not in PAPERS:
        raise DesignError(f"{shown(paper)} is no paper with an experiment here: {nearest(paper, PAPERS)}")
    # Each has its figures, whatever they are, and one form in which it hands them on.
    module = import_module(f"kalmanhdl.reproduce.{paper}")
    figures: Callable[[Progress], Any] = module.figures
    handed: Callable[[Any], Reproduction] = module.reproduction
    return handed(figures(progress))
