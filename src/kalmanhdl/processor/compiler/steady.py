"""The filter with the steady gain, on whole matrices: it keeps the mean alone."""

from collections.abc import Mapping

from kalmanhdl.algorithm import steady_state
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.graph import Array, named
from kalmanhdl.processor.compiler.recipe import Given, Kept, Matrices, Recipe, measured, predicted_mean


def steady(model: LinearModel) -> Recipe:
    """x + K (z - H x) with K of the steady state; a missed measurement has no innovation."""
    prior = steady_state.steady_prior(model)
    K, P = steady_state.optimal_gain(model, prior), steady_state.corrected(model, prior)

    def update(m: Matrices, kept: Kept, given: Given) -> Kept:
        y = named(measured(m, given.z).minus(m.H, kept["x"]), "update: y")
        y = named(given.V @ y, "update: y of what is valid")
        return {"x": named(kept["x"].plus(m.c("K", K), y), "update: x")}

    def finish(m: Matrices, kept: Kept) -> Kept:
        m.c("P", P)
        return kept

    def covariance(values: Mapping[str, Array]) -> Array:
        return values["P"]

    return Recipe(
        vectors=("x",),
        matrices=(),
        begin=lambda m: {},
        predict=lambda m, kept, given: {"x": predicted_mean(m, kept["x"], given)},
        update=update,
        finish=finish,
        variances="P",
        covariance=covariance,
    )
