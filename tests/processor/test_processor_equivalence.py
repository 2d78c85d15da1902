"""The simulator and the Verilog agree on every bit of every instruction, at every clock."""

import random

import numpy as np
import pytest
from random_programs import every_instruction, number, random_peripherals, random_program

from kalmanhdl.algorithm import BiermanThornton, Conventional, Scheduled
from kalmanhdl.errors import VerificationError
from kalmanhdl.model.initial import given
from kalmanhdl.model.motion import constant_velocity
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.processor.compiler.generate import compiled, rows_read, tokens
from kalmanhdl.processor.compiler.trace import traced
from kalmanhdl.processor.instructions import Opcode, build, encode
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.rtl_simulation import Peripherals
from kalmanhdl.processor.simulator import Machine
from kalmanhdl.processor.verification import compare

# More of either: benchmarks/processor.py.
SETS, PROGRAMS = 50, 50


@pytest.fixture
def machine(core):
    return Machine(core, *bench(core, ()))


def test_every_instruction_on_random_operands(core, rtl, machine):
    rng, words = random.Random(1), every_instruction(core)
    tokens = [number(rng, core) for _ in range(2 * core.elements * SETS)]
    assert compare(core, rtl, machine, words, Peripherals(tokens=tokens), len(words) * SETS)


def test_random_programs_with_branches_and_peripherals_of_random_latency(core, rtl, machine):
    rng = random.Random(2)
    for _ in range(PROGRAMS):
        words = random_program(rng, core, rng.randint(2, 60))
        assert compare(core, rtl, machine, words, random_peripherals(rng, core, 20), rng.randint(20, 150))


def test_a_program_that_fills_the_control_store(core, rtl, machine):
    words = random_program(random.Random(3), core, core.program_words)
    assert compare(core, rtl, machine, words, Peripherals(tokens=[1, 2, 3]), 700)


def test_an_instruction_takes_eight_clocks_or_one_and_loading_one_a_word_and_one_more(core, rtl):
    words = [encode(build(Opcode.NOP))] * 3
    assert rtl.load(words, Peripherals()) == core.program_words + 1
    assert list(rtl.run(4).clock) == ([1, 2, 3, 4] if core.pipelined else [7, 15, 23, 31])


@pytest.mark.parametrize(
    ("algorithm", "short"),
    [
        (Conventional(), False),
        (BiermanThornton(), False),
        (BiermanThornton(), True),
        (Scheduled(steps=0), False),
    ],
    ids=["conventional", "bierman_thornton", "bierman_thornton in loops", "steady gain"],
)
def test_filters_run_in_hardware_as_in_the_simulator(core, rtl, machine, algorithm, short):
    if not core.extended or core.numbers.limits[1] < 4:
        pytest.skip("a core without the instructions, or without the numbers, of a filter")
    motion = constant_velocity(T=1.0, noise=0.5)
    model = linear_model(
        motion.F / 2, [[1.0, 0.0]], motion.Q / 16, [[0.25]], initial=given([0, 0], np.eye(2) / 4)
    )
    filter_ = traced(model, algorithm, core.size, short=short)
    z = np.random.default_rng(1).normal(scale=0.1, size=(10, 1))
    read = tokens(filter_, core, rows_read(core, z))
    words = compiled(filter_, core).words
    assert compare(core, rtl, machine, words, Peripherals(tokens=read), len(words) + 150)
    slow = Peripherals(
        tokens=read,
        latencies=[7] * len(read),
        reactions=[2] * len(read),
        sink_latencies=[40, 0],
        sink_reactions=[1, 3],
    )
    assert compare(core, rtl, machine, words, slow, len(words) + 100)


def test_the_first_difference_is_named(core, rtl, machine):
    words = [encode(build(Opcode.READ, 3, 3)), encode(build(Opcode.ADD_33, 3, 3, 5))]
    # The NOPs behind them are there for a result that is stored later.
    compare(core, rtl, machine, words, Peripherals(tokens=[3]), 24)
    machine.data[3][0] = core.numbers.nearest(0.5)
    with pytest.raises(VerificationError, match=r"clock \d+, .*ADD_33 .*values written is \[0, 0"):
        compare(core, rtl, machine, words, Peripherals(tokens=[3]), 24)
