"""The simulator and the Verilog agree on every bit of every instruction, at every clock."""

import random

import pytest
from random_programs import every_instruction, number, random_peripherals, random_program

from kalmanhdl.errors import VerificationError
from kalmanhdl.processor.instructions import Opcode, build, encode
from kalmanhdl.processor.peripherals import BenchSink, BenchSource
from kalmanhdl.processor.rtl_simulation import Peripherals
from kalmanhdl.processor.simulator import Machine
from kalmanhdl.processor.verification import compare

# More of either: benchmarks/processor.py.
SETS, PROGRAMS = 50, 50


@pytest.fixture
def machine(core):
    return Machine(core, BenchSource(()), BenchSink())


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


def test_an_instruction_takes_eight_clocks_and_loading_one_a_word_and_one_more(core, rtl):
    words = [encode(build(Opcode.NOP))] * 3
    assert rtl.load(words, Peripherals()) == core.program_words + 1
    assert list(rtl.run(4).clock) == [7, 15, 23, 31]


def test_the_first_difference_is_named(core, rtl, machine):
    words = [encode(build(Opcode.READ, 3, 3)), encode(build(Opcode.ADD_33, 3, 3, 5))]
    compare(core, rtl, machine, words, Peripherals(tokens=[3]), 2)
    machine.data[3][0] = 1
    with pytest.raises(VerificationError, match=r"clock 15, ADD_33 .*values written is \[0, 0"):
        compare(core, rtl, machine, words, Peripherals(tokens=[3]), 2)
