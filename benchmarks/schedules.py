"""Schedules of shared operators by the list alone and with the solver, side by side.

    python benchmarks/schedules.py [--only WORD] [--seconds 2]

For each filter and its operators: interval and latency of both, what was proven of any schedule, bits of
registers between operators and of memories before them, and processor seconds.
"""

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from kalmanhdl.algorithm import BiermanThornton, Taylor
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.model.initial import given, three_point
from kalmanhdl.model.state_space import LinearModel, linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import numbers_of, wanted
from kalmanhdl.reproduce.liu2007 import chosen_model
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.summary import summarise
from kalmanhdl.target import device

DESIGNS = Path(__file__).parents[1] / "designs"


def accelerating() -> LinearModel:
    """Constant acceleration in the plane: six states, two positions measured."""
    move, into = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]), np.array([0.5, 1.0, 1.0])
    F, H = np.kron(np.eye(2), move), np.kron(np.eye(2), [[1.0, 0.0, 0.0]])
    Q = np.kron(np.eye(2), 0.01 * np.outer(into, into))
    return linear_model(F, H, Q, 25.0 * np.eye(2), initial=three_point())


def dense(n: int) -> LinearModel:
    """States that all push each other, three measurements of all of them."""
    random = np.random.default_rng(1)
    F = random.standard_normal((n, n))
    F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
    H, root = random.standard_normal((3, n)), random.standard_normal((n, n))
    Q = root @ root.T / n + 0.2 * np.eye(n)
    return linear_model(F, H, Q, np.eye(3), initial=given(np.zeros(n), 4.0 * np.eye(n)))


def of(model: LinearModel, width: int, algorithm: object = "conventional", **units: int) -> Design:
    """A design of a model on shared operators."""
    return Design(
        name="filter",
        model=model,
        algorithm=algorithm,
        numerics=FixedSpecification(width=width),
        architecture=Architecture(units=units),
        target=Target(device="ecp5-85k", grade=8),
    )


def lee(channels: int, **units: int) -> Design:
    """The radar filter of lee1997 on shared operators."""
    design = Design.load(DESIGNS / "lee1997.toml")
    return replace(design, architecture=Architecture(units=units, channels=channels))


CASES: dict[str, Callable[[], Design]] = {
    "kumar2014_time_multiplexed": lambda: Design.load(DESIGNS / "kumar2014_time_multiplexed.toml"),
    "lee1997, 1 multiply, 1 reciprocal": lambda: lee(1, multiply=1, reciprocal=1),
    "lee1997, 2 multiply, 1 reciprocal": lambda: lee(1, multiply=2, reciprocal=1),
    "lee1997, the same, 4 tracks": lambda: lee(4, multiply=2, reciprocal=1),
    "liu2007 Taylor, 8 multiply": lambda: of(chosen_model(), 16, Taylor(about="initial"), multiply=8),
    "liu2007 UD, 8 multiply, 2 divide": lambda: of(
        chosen_model(), 16, BiermanThornton(), multiply=8, divide=2
    ),
    "6 states, 4 multiply": lambda: of(accelerating(), 18, multiply=4),
    "6 states, 2 multiply, 4 add": lambda: of(accelerating(), 18, multiply=2, add=4),
    "6 dense states, 12 multiply": lambda: of(dense(6), 18, multiply=12),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cases with this word in their name")
    parser.add_argument("--seconds", type=float, default=2.0, help="the solver's own")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    print("filter | by | interval | least | latency | least | register bits | memory bits | seconds")
    for name, make in CASES.items():
        if arguments.only in name:
            _compare(name, make(), arguments.seconds)


def _compare(name: str, design: Design, seconds: float) -> None:
    part = device(design.target.device, design.target.grade)
    typed, asked = numbers_of(design).typed, wanted(design.architecture, part)
    for by, allowed in (("list", 0.0), ("solver", seconds)):
        begin = time.process_time()
        plan = schedule(typed, part, replace(asked, solver_seconds=allowed))
        spent = time.process_time() - begin
        assert not problems(plan, part)
        found = summarise(plan, part)
        print(
            f"{name} | {by} | {plan.interval} | {plan.least_interval} | {plan.latency} | "
            f"{plan.least_latency} | {found.register_bits} | {found.memory_bits} | {spent:.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
