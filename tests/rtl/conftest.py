"""Graphs and devices made for the tests of schedules serve here as well."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "schedule"))
