"""A run without a C compiler: the interpreter, track by track, with the engine's arrays."""

from collections.abc import Iterable, Mapping

import numpy as np

from kalmanhdl.numerics.floating import FloatGraph, Unbounded
from kalmanhdl.numerics.typed import Interval, TypedGraph
from kalmanhdl.simulate.arrays import Arrays, Results
from kalmanhdl.simulate.float_interpreter import interpret_float
from kalmanhdl.simulate.interpreter import Step, interpret, next_state
from kalmanhdl.simulate.limbs import Integers, from_limbs, to_limbs
from kalmanhdl.simulate.program import INITIALISE, Port, Program


def run_interpreted(
    typed: TypedGraph | FloatGraph, program: Program, arrays: Arrays, results: Results
) -> tuple[list[int], dict[int, Interval]]:
    """Fill the results. Returns the counts of saturations and violations, and all extremes."""
    counts = [0] * (len(program.counted) + len(program.violations))
    extremes: dict[int, Interval] = {}
    for track in range(arrays.tracks):
        state = {p.name: _get(p, a, track) for p, a in zip(program.states, arrays.state, strict=True)}
        for step in range(arrays.steps):
            at = (step, track)
            if arrays.active is None or arrays.active[at]:
                done, state = _step(typed, _given(program, arrays, at), state)
                _widen(program, done, extremes)
                for n, hit in enumerate(_hits(typed, program, done)):
                    counts[n] += hit
                shown = (done.values[port.index] for port in program.outputs)
                _put_all(program.outputs, results.outputs, at, shown)
            _put_all(program.states, results.records, at, state.values())
        _put_all(program.states, arrays.state, track, state.values())
    return counts, extremes


def _step(
    typed: TypedGraph | FloatGraph, given: Mapping[str, int], state: Mapping[str, int]
) -> tuple[Step, dict[str, int]]:
    """What a step computes, and the states that it leaves."""
    if isinstance(typed, FloatGraph):
        done = interpret_float(typed, given, state)
        return done, {name: done.values[root] for name, root in typed.graph.states}
    done = interpret(typed, given, state)
    return done, next_state(typed, done.values)


_Place = int | tuple[int, int]


def _given(program: Program, arrays: Arrays, at: _Place) -> Mapping[str, int]:
    ports = zip((*program.inputs, *program.flags), (*arrays.inputs, *arrays.flags), strict=True)
    return {port.name: _get(port, array, at) for port, array in ports}


def _hits(typed: TypedGraph | FloatGraph, program: Program, done: Step) -> Iterable[bool]:
    """Whether each counted operation saturated, then whether each violation matters."""
    starts = any(done.values[port.index] for port in program.flags if port.name == INITIALISE)
    yield from (index in done.saturated for index in program.counted)
    for violation in typed.violations:
        if isinstance(violation, Unbounded):
            happens = violation.value in done.saturated
        else:
            happens = bool(done.values[violation.outside])
        yield happens and (violation.starting if starts else violation.running)


def _widen(program: Program, done: Step, extremes: dict[int, Interval]) -> None:
    for port in program.watched:
        value = done.values[port.index]
        before = extremes.get(port.index, Interval(low=value, high=value))
        extremes[port.index] = Interval(low=min(before.low, value), high=max(before.high, value))


def _get(port: Port, array: Integers, at: _Place) -> int:
    return int(from_limbs(array[at]) if port.limbs else array[at])


def _put_all(ports: Iterable[Port], arrays: Iterable[Integers], at: _Place, values: Iterable[int]) -> None:
    for port, array, value in zip(ports, arrays, values, strict=False):
        array[at] = to_limbs(np.array(value, dtype=object), port.limbs) if port.limbs else value
