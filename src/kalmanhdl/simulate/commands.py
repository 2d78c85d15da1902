"""Which command each row of data is for its track."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.model import Model


class Command(IntEnum):
    """What a track is asked to do, as it stands on the hardware's stream; ``NONE`` is no step at all."""

    NONE = -1
    INITIALISE = 0
    PREDICT = 1
    UPDATE = 2


def commands(model: Model, z: NDArray[np.float64], active: NDArray[np.bool_]) -> NDArray[np.int8]:
    """The commands for rows of data. Shapes: z (steps, tracks, m), NaN where missed; others (steps, tracks).

    A track starts with its first row, or, where the start takes measurements, with the first complete
    rows in succession that suffice; rows before that are no step. A row with no valid component predicts.
    """
    seen = ~np.isnan(z)
    result = np.where(active, np.where(seen.any(axis=2), Command.UPDATE, Command.PREDICT), Command.NONE)
    for track in range(z.shape[1]):
        rows = np.flatnonzero(active[:, track])
        begin = _start(model, seen[rows, track].all(axis=1))
        points = model.initial.points
        result[rows[:begin], track] = Command.NONE
        result[rows[begin : begin + points], track] = Command.INITIALISE
    return result.astype(np.int8)


def _start(model: Model, complete: NDArray[np.bool_]) -> int:
    if not model.initial.takes_measurements:
        return 0
    points = model.initial.points
    for begin in range(len(complete) - points + 1):
        if complete[begin : begin + points].all():
            return begin
    return len(complete)


def started(model: Model, given: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Where there is an estimate: from the last command ``initialise`` of a track's start on."""
    initialised = np.cumsum(given == Command.INITIALISE, axis=0)
    return np.asarray((initialised >= model.initial.points) & (given != Command.NONE))
