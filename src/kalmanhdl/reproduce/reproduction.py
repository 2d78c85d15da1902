"""What a reproduction hands on: its figures beside the paper's, what it rests on, and its pictures."""

from collections.abc import Mapping
from dataclasses import dataclass

from kalmanhdl.report.chart import Chart


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """Rows of text below ``columns``, the first saying what; notes; charts by the name of their file."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]
    charts: Mapping[str, Chart]
