"""A small rotary UAV as a ground radar would see it every second: the model and the plots of a measured path.

``uav_radar.csv`` is that of the design files' data, whose README tells its source and its noise.
"""

import math
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.converted import ConvertedModel, converted_model
from kalmanhdl.model.initial import three_point
from kalmanhdl.model.singer import singer

Array = NDArray[np.float64]

UAV_PERIOD_S, UAV_TAU_S = 1.0, 5.0
UAV_NOISE = (1.0, 1.0, 0.2)
"""What the UAV accelerates by (m/s^2) towards east, north and up."""

UAV_SIGMAS = (3.14, 0.6 * math.pi / 180, math.sqrt(10) * math.pi / 180)
"""Of range (m), azimuth and elevation (rad)."""

UAV_SETTLED = 30
"""Seconds after which the filter is compared with the plots."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """Plots z (steps, 1, 3): range, azimuth, elevation, in m and rad; ``truth`` (steps, 3): position in m."""

    z: Array
    truth: Array


def uav_model() -> ConvertedModel:
    """Singer acceleration in east, north and up, spherical plots, three of them to start."""
    motion = singer(
        T=UAV_PERIOD_S, tau=UAV_TAU_S, noise=UAV_NOISE, axes=["east", "north", "up"], order="derivative"
    )
    return converted_model(
        motion.F,
        motion.H,
        motion.Q,
        np.diag(np.square(UAV_SIGMAS)),
        initial=three_point(),
        state_names=motion.state_names,
        state_units=("m",) * 3 + ("m/s",) * 3 + ("m/s^2",) * 3,
        measurement_range=np.array([[100, 2000], [-math.pi, math.pi], [-math.pi / 2, math.pi / 2]]),
    )


def uav_track() -> Track:
    """The plots of the path, and the path."""
    lines = files(__package__).joinpath("uav_radar.csv").read_text(encoding="utf-8").splitlines()
    table = np.loadtxt(lines, delimiter=",", skiprows=1)
    return Track(z=table[:, None, 1:4], truth=table[:, 4:7])
