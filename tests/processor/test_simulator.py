"""What the instructions do, against exact rationals and against the paper's protocol."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from function_graphs import exact
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.operations import Function
from kalmanhdl.processor.arithmetic import compute
from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.core import PAPER_CORE, Core
from kalmanhdl.processor.instructions import FUNCTIONS, Instruction, Opcode, build
from kalmanhdl.processor.peripherals import BenchSink, BenchSource, HandshakingSink, HandshakingSource
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.trace import dump, trace_line

CORE = Core(form=Fixed(width=16, fraction=8), extended=True)
RAW = st.integers(CORE.form.lowest, CORE.form.highest)
MATRIX = st.lists(RAW, min_size=9, max_size=9)


def by_numpy(opcode, a, b):
    """The same operation on exact rationals, by NumPy's own products."""
    A, B = (np.array([CORE.form.real(raw) for raw in each], object).reshape(3, 3) for each in (a, b))
    match opcode:
        case Opcode.ADD_33:
            return A + B
        case Opcode.MULT_33:
            return A @ B
        case Opcode.SUB_33:
            return A - B
        case Opcode.MULT_33T:
            return A @ B.T
        case Opcode.TRANS_33:
            return A.T
        case Opcode.COPY:
            return A
        case Opcode.MULT_31:
            return A @ B[0]
        case Opcode.MULT_3S:
            return A * B[0, 0]
        case Opcode.DET_33:
            minors = [A[0, k] * A[1, (k + 1) % 3] * A[2, (k + 2) % 3] for k in range(3)]
            others = [A[0, k] * A[1, (k + 2) % 3] * A[2, (k + 1) % 3] for k in range(3)]
            return np.array(sum(minors) - sum(others))


EXACT = ["ADD_33", "SUB_33", "MULT_33", "MULT_33T", "MULT_31", "MULT_3S", "DET_33", "TRANS_33", "COPY"]


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from([Opcode[name] for name in EXACT]), MATRIX, MATRIX)
def test_an_element_is_exact_and_then_rounded_and_clamped_once(opcode, a, b):
    values, outside = compute(Instruction(opcode), a, b, CORE)
    reals = by_numpy(opcode, a, b).ravel()
    assert values == [CORE.form.nearest(Fraction(real)) for real in reals]
    limits = [CORE.form.lowest <= round(Fraction(real) * 256) <= CORE.form.highest for real in reals]
    assert outside == (not all(limits))


@given(MATRIX, MATRIX)
def test_elements_and_first_rows_are_multiplied_and_rounded_once(a, b):
    real = CORE.form.real
    each, _ = compute(Instruction(Opcode.HAD_33), a, b, CORE)
    assert each == [CORE.form.nearest(real(x) * real(y)) for x, y in zip(a, b, strict=True)]
    outer, _ = compute(Instruction(Opcode.OUTER_33), a, b, CORE)
    assert outer == [CORE.form.nearest(real(x) * real(y)) for x in a[:3] for y in b[:3]]


@given(st.integers(-8, 6), MATRIX)
def test_a_power_of_two_scales_exactly_and_is_rounded_once(exponent, a):
    values, _ = compute(build(Opcode.SCALE, 0, exponent, 0), a, a, CORE)
    assert values == [CORE.form.nearest(CORE.form.real(raw) * Fraction(2) ** exponent) for raw in a]


@given(MATRIX)
def test_the_adjugate_times_the_matrix_is_the_determinant(a):
    small = [raw >> 11 for raw in a]
    core = Core(form=Fixed(width=32, fraction=0), extended=True)
    adjugate, _ = compute(Instruction(Opcode.ADJ_33), small, small, core)
    determinant, _ = compute(Instruction(Opcode.DET_33), small, small, core)
    product, _ = compute(Instruction(Opcode.MULT_33), small, adjugate, core)
    assert product == [determinant[0] if k % 4 == 0 else 0 for k in range(9)]


@given(RAW)
def test_a_reciprocal_is_right_to_the_last_bit(raw):
    values, outside = compute(build(Opcode.RECIP, 0, 4, 0), [*[0] * 4, raw, *[0] * 4], [], CORE)
    if raw <= 0:
        assert (values, outside) == ([CORE.form.highest], True)
    else:
        exact = Fraction(2) ** 16 / raw
        assert abs(values[0] - min(exact, CORE.form.highest)) <= 1
        assert outside == (round(exact) > CORE.form.highest)


@given(st.sampled_from(FUNCTIONS), RAW, RAW)
def test_a_function_is_right_to_the_last_bit_and_told_where_it_does_not_fit(function, a, b):
    core = replace(CORE, functions=FUNCTIONS)
    instruction = build(Opcode.FUNC, 0, FUNCTIONS.index(function), 0)
    (value,), outside = compute(instruction, [a, b, *[7] * 7], [], core)
    one = 1 << core.form.fraction
    wanted = exact(function, Fraction(a, one), Fraction(b, one)) * one
    assert core.form.lowest <= value <= core.form.highest
    off = float(abs(value - min(wanted, core.form.highest)))
    if function in (Function.ARCTANGENT, Function.WRAP):
        # Half a turn to either side is the same angle.
        off = min(off, abs(off - one))
    assert off <= 1.0
    assert outside == (value == core.form.highest and wanted > core.form.highest)


def test_loops_in_loops_are_passed_as_often_as_they_say():
    made = machine("LOOP 3\nA: ADD_33 0 1 0\nLOOP 2\nB: ADD_33 2 1 2\nNEXT B\nNEXT A\nHALT", ())
    made.data[1][0] = 1
    done = run(made, 100)
    assert (done.reason, done.instructions) == ("halted at address 6", 1 + 3 * (3 + 2 * 2))
    assert (made.data[0][0], made.data[2][0]) == (3, 6)


def test_elements_are_picked_and_placed():
    made = machine("PICK 1 5 2\nPLACE 2 7 3\nHALT", ())
    made.data[1] = list(range(9))
    run(made, 3)
    assert made.data[2] == [5] + [0] * 8
    assert made.data[3] == [0] * 7 + [5, 0]


def machine(source, tokens, core=CORE, **peripherals):
    made = Machine(core, BenchSource(tokens), BenchSink())
    made.load(assemble(source, core).words)
    return made


def test_a_vector_is_a_row_and_a_number_its_first_element():
    made = machine("MULT_31 1 2 3\nMULT_3S 1 2 4\nDET_33 1 5", ())
    made.data[1] = [256 * k for k in (1, 2, 3, 4, 5, 6, 7, 8, 10)]
    made.data[2] = [256 * k for k in (1, 0, 2, 9, 9, 9, 9, 9, 9)]
    made.data[3] = made.data[5][:] = [7] * 9
    made.data[5] = [7] * 9
    run(made, 3)
    assert made.data[3] == [256 * k for k in (7, 16, 27)] + [7] * 6
    assert made.data[4] == made.data[1]
    assert made.data[5] == [256 * -3] + [7] * 8


def test_a_slow_source_is_waited_for():
    source = """
    L1: JUMP_DRDY L1
        READ 0 5
    L2: JUMP_ACK L2
        WRITE 5 0
        JUMP_U L1
    """
    made = Machine(
        CORE,
        HandshakingSource([3, 1, 4, 1, 5], [0, 100, 7, 55, 0], [0, 4, 2, 1, 0]),
        HandshakingSink([0, 300, 9], [3, 0] * 2),
    )
    made.load(assemble(source, CORE).words)
    done = run(made, 1000)
    assert done.sent == (3, 1, 4, 1, 5)
    assert done.reason == "the input is exhausted"
    assert made.clock == 8 * done.instructions > 400


def test_the_handshakes_move_as_the_paper_has_them():
    made = machine("READ 0 1\nL1: JUMP_DRDY L1\nWRITE 1 0\nL2: JUMP_ACK L2\nNOP", (5, 6))
    seen = []
    for _ in range(5):
        made.retire()
        seen.append((made.time.acknowledge, made.time.ready, made.time.data_out))
    assert seen == [
        (True, False, 0),
        (False, False, 0),
        (False, True, 5),
        (False, False, 5),
        (False, False, 5),
    ]


def test_a_run_stops_at_a_label_and_where_the_input_ends():
    made = machine("READ 0 1\nL: ADD_33 1 1 1\nJUMP_U L", (1,))
    assert run(made, 100, frozenset({1})).reason == "stopped at address 1"
    made = machine("L: READ 0 1\nJUMP_U L", (1, 2, 3))
    done = run(made, 100)
    assert (done.reason, done.instructions) == ("the input is exhausted", 6)


def test_a_trace_shows_real_numbers_under_their_names():
    program = assemble("START: READ 0 X\nADD_33 X X Y\nWRITE Y 0\n.data\nX:\nY:", CORE)
    made = Machine(CORE, BenchSource((384,)), BenchSink())
    made.load(program.words)
    lines = []
    run(made, 3, watch=lambda done: lines.append(trace_line(done, made, program)))
    assert [line.split() for line in lines] == [
        ["8", "0", "START:", "READ", "0", "0", "0[0]", "=", "1.5"],
        ["16", "1", "ADD_33", "0", "0", "1", "1", "=", "3.0", *["0.0"] * 8],
        ["24", "2", "WRITE", "1", "0", "out", "3.0"],
    ]
    assert dump(made, program).splitlines()[:2] == ["X (0)", "  1.5  0.0  0.0"]


def test_what_does_not_fit_is_told():
    made = machine("MULT_3S 1 1 2", (), PAPER_CORE)
    made.data[1] = [100] * 9
    assert run(made, 1).reason == "1 instructions are done"
    assert made.saturated
