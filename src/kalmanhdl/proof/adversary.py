"""Inputs that try to drive values out of their formats, within the contract of a proof.

They stay in the declared ranges and miss no measurement too often: anywhere, at the ends of the ranges, on
square waves of every period, and kept while they drive a state further out.
"""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.operations import Flag, Input
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.proof.intervals import leaves
from kalmanhdl.proof.prove import Proof, input_limits
from kalmanhdl.simulate.engine import Engine, Trace

Integers = NDArray[np.int64]

_PERIODS = 24


def attack(model: Model, typed: TypedGraph, proof: Proof, *, steps: int, tracks: int, seed: int) -> Trace:
    """A monitored run of the engine under inputs that keep the contract and do their worst.

    A track in eight jumps at random, the others follow square waves whose periods differ, some with misses.
    """
    random = np.random.default_rng(seed)
    limits, places, engine = input_limits(model, typed), leaves(typed), Engine.of(typed)
    inputs = {}
    for operation in typed.graph.operations:
        if isinstance(operation, Input):
            form = typed.formats[places[operation.name]]
            assert form is not None
            found = limits.get(operation.name)
            ends = (form.lowest, form.highest) if found is None else (found.low, found.high)
            inputs[operation.name] = _waves(random, ends, steps, tracks)
    contract = proof.contract
    initialise = np.zeros((steps, tracks), bool)
    initialise[: contract.points] = True
    flags = {"initialise": initialise}
    for operation in typed.graph.operations:
        if isinstance(operation, Flag) and operation.name != "initialise":
            flags[operation.name] = _present(random, steps, tracks, contract.coast)
            flags[operation.name][: contract.points] |= contract.always
    first = engine.run(
        {name: array[: contract.points - 1] for name, array in inputs.items()},
        {name: array[: contract.points - 1] for name, array in flags.items()},
        record_states=False,
    )
    return engine.run(
        {name: array[contract.points - 1 :] for name, array in inputs.items()},
        {name: array[contract.points - 1 :] for name, array in flags.items()},
        initial_state=first.final_state,
        monitor=True,
        record_states=False,
    )


def _waves(random: np.random.Generator, ends: tuple[int, int], steps: int, tracks: int) -> Integers:
    period = random.integers(1, _PERIODS, (1, tracks), endpoint=True)
    phase = random.integers(0, _PERIODS, (1, tracks))
    high = ((np.arange(steps)[:, None] + phase) // period) % 2 == 1
    erratic = np.arange(tracks) % 8 == 0
    high[:, erratic] = random.random((steps, int(erratic.sum()))) < 0.5
    anywhere = random.integers(ends[0], ends[1], (steps, tracks), endpoint=True)
    corner = np.where(high, ends[1], ends[0])
    return np.asarray(np.where(random.random((1, tracks)) < 0.1, anywhere, corner), np.int64)


def _present(random: np.random.Generator, steps: int, tracks: int, coast: int) -> NDArray[np.bool_]:
    """Which measurements there are: on most tracks all, on some as few as may be, or some at random."""
    often = random.choice([0.0, 0.0, 0.3, 1.0], tracks)
    present = np.ones((steps, tracks), bool)
    missed = np.zeros(tracks, int)
    for row in present:
        row[:] = (random.random(tracks) >= often) | (missed >= coast)
        missed = np.where(row, 0, missed + 1)
    return present
