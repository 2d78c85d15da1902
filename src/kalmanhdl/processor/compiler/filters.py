"""The algorithms that have programs."""

import numpy as np

from kalmanhdl.algorithm import (
    Algorithm,
    BiermanThornton,
    Conventional,
    Extended,
    Joseph,
    Scheduled,
    Sequential,
    Taylor,
    steady_state,
)
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.covariance import (
    gained,
    inverted,
    keeping_covariance,
    sequential,
    sequential_stages,
    sweeping,
)
from kalmanhdl.processor.compiler.expansion import expanded, leaving_out
from kalmanhdl.processor.compiler.extended import extended
from kalmanhdl.processor.compiler.factors import factored
from kalmanhdl.processor.compiler.recipe import Filtered, Recipe
from kalmanhdl.processor.compiler.steady import steady


def recipe_of(algorithm: Algorithm, model: Filtered, size: int) -> Recipe:
    """The filter of an algorithm. Raises ProgramError for one that has no program."""
    if isinstance(model, NonlinearModel):
        assert isinstance(algorithm, Extended), algorithm
        return extended(model, algorithm)
    return _linear(algorithm, model, size)


def _linear(algorithm: Algorithm, model: LinearModel, size: int) -> Recipe:
    match algorithm:
        case Conventional() | Joseph():
            joseph = isinstance(algorithm, Joseph)
            return keeping_covariance(
                lambda m, x, P, z, V: gained(m, x, P, z, V, inverted(m, size), joseph=joseph),
                sweeping(model, size, joseph=joseph),
            )
        case Taylor():
            S0 = steady_state.innovation_covariance(model, algorithm.point(model))
            # What is nothing but rounding beside the variances correlates nothing.
            S0[np.abs(S0) <= 8 * np.finfo(np.float64).eps * np.sqrt(np.outer(np.diag(S0), np.diag(S0)))] = 0.0
            newton = algorithm.newton
            return keeping_covariance(
                lambda m, x, P, z, V: gained(m, x, P, z, V, expanded(m, V, S0, newton), joseph=True),
                leaving_out(model, S0, newton),
            )
        case Sequential():
            return keeping_covariance(sequential, sequential_stages(model))
        case BiermanThornton():
            return factored(model)
        case Scheduled(steps=0):
            return steady(model)
        case Scheduled():
            raise ProgramError(
                '[algorithm] "scheduled" has a program for the steady gain alone: write steps = 0'
            )
        case _:
            kinds = "conventional, joseph, sequential, taylor, bierman_thornton, or scheduled with steps = 0"
            raise ProgramError(f'[algorithm] kind = "{algorithm.kind}" has no program: choose {kinds}')
