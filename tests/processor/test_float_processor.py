"""The processor on floating-point numbers: what its instructions mean, its programs, what is refused."""

import random
import shutil
from dataclasses import replace

import numpy as np
import pytest
from random_programs import float_number
from typer.testing import CliRunner

from every_algorithm import covering
from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.cli import app
from kalmanhdl.design_file import loads
from kalmanhdl.errors import DesignError, ProgramError
from kalmanhdl.graph.functions import value_of
from kalmanhdl.graph.operations import Function
from kalmanhdl.processor.arithmetic import compute
from kalmanhdl.processor.checks import drawn_rows
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import tokens
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.fit import fitted
from kalmanhdl.processor.follow import follow, rows_of
from kalmanhdl.processor.instructions import FUNCTIONS, MINORS, Opcode, build
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.simulators import bench_runs
from kalmanhdl.processor.timing import clocks_of_instruction, latency
from kalmanhdl.processor.verilog import core_verilog
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.toolchain.simulators import Simulator

FORMS = (Float(8, 23), Float(5, 10), Float(5, 10, subnormals=False), Float(4, 3, Rounding.TOWARD_ZERO))


class Definition:
    """Every instruction by operations on single numbers, in the order that docs/processor.md says."""

    def __init__(self, form, size, a, b, c):
        self.form, self.n = form, size
        self.a, self.b, self.c = ([x[i * size : (i + 1) * size] for i in range(size)] for x in (a, b, c))

    def add(self, x, y):
        return floating.add(self.form, x, y)

    def less(self, x, y):
        return floating.subtract(self.form, x, y)

    def times(self, x, y):
        return floating.multiply(self.form, x, y)

    def sum(self, terms):
        while len(terms) > 1:
            odd = terms[len(terms) // 2 * 2 :]
            terms = [self.add(x, y) for x, y in zip(terms[::2], terms[1::2], strict=False)] + odd
        return terms[0]

    def dot(self, x, y):
        return self.sum([self.times(p, q) for p, q in zip(x, y, strict=True)])

    def each(self, make):
        return [make(i, j) for i in range(self.n) for j in range(self.n)]

    def column(self, j):
        return [row[j] for row in self.b]

    def symmetric(self, joined):
        return self.each(
            lambda i, j: joined(self.c[min(i, j)][max(i, j)], self.dot(self.a[min(i, j)], self.b[max(i, j)]))
        )

    def cofactors(self):
        a = [x for row in self.a for x in row]
        return [self.less(self.times(a[p], a[q]), self.times(a[r], a[s])) for p, q, r, s in MINORS]

    def elements(self, opcode, immediate):
        a, b, c, n = self.a, self.b, self.c, self.n
        one = self.form.nearest(1.0)
        match opcode:
            case Opcode.ADD_33:
                return self.each(lambda i, j: self.add(a[i][j], b[i][j]))
            case Opcode.SUB_33:
                return self.each(lambda i, j: self.less(a[i][j], b[i][j]))
            case Opcode.MULT_33:
                return self.each(lambda i, j: self.dot(a[i], self.column(j)))
            case Opcode.MULT_33T:
                return self.each(lambda i, j: self.dot(a[i], b[j]))
            case Opcode.MULT_3S:
                return self.each(lambda i, j: self.times(a[i][j], b[0][0]))
            case Opcode.HAD_33:
                return self.each(lambda i, j: self.times(a[i][j], b[i][j]))
            case Opcode.OUTER_33:
                return self.each(lambda i, j: self.times(a[0][i], b[0][j]))
            case Opcode.MULT_31:
                return [self.dot(a[i], b[0]) for i in range(n)]
            case Opcode.MADD_31:
                return [self.add(c[0][i], self.dot(a[i], b[0])) for i in range(n)]
            case Opcode.MSUB_31:
                return [self.less(c[0][i], self.dot(a[i], b[0])) for i in range(n)]
            case Opcode.SYMADD_33:
                return self.symmetric(self.add)
            case Opcode.SYMSUB_33:
                return self.symmetric(self.less)
            case Opcode.SCALE:
                return self.each(lambda i, j: floating.scale(self.form, a[i][j], immediate))
            case Opcode.RECIP:
                return [floating.divide(self.form, one, a[immediate // n][immediate % n])]
            case Opcode.ADJ_33:
                found = self.cofactors()
                return self.each(lambda i, j: found[3 * j + i])
            case Opcode.DET_33:
                return [self.dot(a[0], self.cofactors()[:3])]
            case Opcode.MASK_33:
                return self.each(lambda i, j: a[i][j] if self.form.magnitude(b[i][i]) else 0)
            case _:
                raise AssertionError(opcode)


IMMEDIATE = {Opcode.SCALE: (-7, 0, 3), Opcode.RECIP: (0, 3)}
DEFINED = (
    *(Opcode.ADD_33, Opcode.SUB_33, Opcode.MULT_33, Opcode.MULT_33T, Opcode.MULT_3S, Opcode.HAD_33),
    *(Opcode.OUTER_33, Opcode.MULT_31, Opcode.MADD_31, Opcode.MSUB_31, Opcode.SYMADD_33, Opcode.SYMSUB_33),
    *(Opcode.SCALE, Opcode.RECIP, Opcode.ADJ_33, Opcode.DET_33, Opcode.MASK_33),
)


@pytest.mark.parametrize("size", [2, 3, 5])
@pytest.mark.parametrize("form", FORMS, ids=repr)
def test_an_instruction_is_operations_of_floats_in_the_order_of_the_documents(form, size):
    core, rng = Core(form=form, size=size, extended=True), random.Random(size)
    for opcode in DEFINED:
        if not core.has(opcode):
            continue
        for immediate in IMMEDIATE.get(opcode, (None,)):
            for _ in range(15):
                a, b, c = (
                    [form.canonical(float_number(rng, form)) for _ in range(core.elements)] for _ in range(3)
                )
                operands = (0, 1, 2) if immediate is None else (0, immediate, 2)
                instruction = build(opcode, *operands[: len(build_operands(opcode)) - 1], 2)
                found, outside = compute(instruction, a, b, core, c)
                wanted = Definition(form, size, a, b, c).elements(opcode, immediate)
                assert found == wanted, (opcode, a, b, c)
                lost = any(form.magnitude(raw) >= form.infinity for raw in wanted)
                assert outside == (lost and opcode is not Opcode.MASK_33)


def build_operands(opcode):
    return build(opcode, *[0] * OPERANDS[opcode]).operation.operands


OPERANDS = dict.fromkeys(DEFINED, 3) | {Opcode.ADJ_33: 2, Opcode.DET_33: 2}


@pytest.mark.parametrize("function", FUNCTIONS)
def test_functions_are_those_of_hardware_of_its_own_within_a_few_last_bits(function):
    form = Float(8, 23)
    core, rng = Core(form=form, extended=True, functions=(function,)), np.random.default_rng(1)
    for x, y in rng.uniform(0.01, 3.0, (40, 2)):
        a = [form.nearest(x), form.nearest(y), *[0] * 7]
        (found,), outside = compute(build(Opcode.FUNC, 0, FUNCTIONS.index(function), 1), a, a, core)
        exact = value_of(function, float(form.real(a[0])), float(form.real(a[1])))
        assert not outside
        assert abs(float(form.real(found)) - exact) <= 4 * 2.0**-24 * max(abs(exact), 0.25)
    (found,), outside = compute(build(Opcode.FUNC, 0, FUNCTIONS.index(function), 1), [form.nan] * 9, a, core)
    assert outside or function in (Function.ARCTANGENT, Function.EXPONENTIAL, Function.HYPOTENUSE)


def test_an_instruction_takes_eight_clocks_as_often_as_it_must():
    core = Core(form=Float(8, 23), extended=True)
    clocks = {opcode: clocks_of_instruction(opcode, core) for opcode in Opcode if core.has(opcode)}
    assert {clocks[each] for each in (Opcode.NOP, Opcode.COPY, Opcode.READ, Opcode.JUMP_U)} == {8}
    assert all(clock % 8 == 0 for clock in clocks.values())
    assert clocks[Opcode.HAD_33] == 16 < clocks[Opcode.MULT_33] == 24
    overlapping = replace(core, units=1)
    assert latency(Opcode.HAD_33, overlapping) < latency(Opcode.MULT_31, overlapping)


CAR = """
name = "car"
[model]
kind = "linear"
state = ["p", "v", "q", "w"]
measurement = ["a", "b"]
F = [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
H = [[1, 0, 0.5, 0], [0, 0, 1, 0]]
Q = { diagonal = [0.01, 0.2, 0.01, 0.1] }
R = [[4.0, 1.0], [1.0, 2.0]]
[model.initial]
kind = "given"
x = [0, 1, 0, -1]
P = { diagonal = [2, 1, 2, 1] }
[algorithm]
kind = "conventional"
[numerics]
kind = "float"
format = "single"
[architecture]
kind = "processor"
"""
KINDS = ("conventional", "joseph", "sequential", "taylor", "bierman_thornton")


def plots_of(fit, steps):
    z = np.cumsum(np.random.default_rng(1).normal(size=(steps, fit.given.m)), axis=0)
    z[7] = z[11, 0] = z[12, 1] = np.nan
    return plots_from_arrays(z, fit.given)


@pytest.mark.parametrize("multipliers", [0, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_filters_run_as_the_engine_says_and_near_double_precision(kind, multipliers):
    # An expansion that converges though plots are missed in a row.
    about = f"\nabout = {covering(loads(CAR).model).tolist()}" if kind == "taylor" else ""
    text = CAR.replace('"conventional"', f'"{kind}"{about}') + f"multipliers = {multipliers}\n"
    fit = fitted(loads(text))
    assert fit.core.form == Float(8, 23)
    plots = plots_of(fit, 30)
    (rows,) = rows_of(fit.core, fit.given, fit.scaling, plots)
    engine = Engine(fit.filter_, fit.core)
    wanted = [number for row in rows for number in engine.step(row)]
    machine = Machine(fit.core, *bench(fit.core, tokens(fit.filter_, fit.core, rows)))
    # Whatever a program before has left, infinities and NaN among it.
    machine.data = [[fit.core.float_form.nan] * fit.core.elements for _ in machine.data]
    machine.load(fit.program.words)
    assert list(run(machine, 1_000_000).sent) == wanted
    assert not machine.saturated
    found = follow(fit.filter_, fit.core, fit.given, fit.design.algorithm, fit.scaling, plots)
    assert (found.saturations, found.clipped) == (0, 0)
    np.testing.assert_allclose(found.exact.x, found.reference.x, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('format = "single"', 'format = "double"', '[numerics] kind = "float": its numbers have 64 bits'),
        ('format = "single"', "exponent = 3\nmantissa = 3", "its numbers have 7 bits, and the processor's"),
        ('format = "single"', "exponent = 3\nmantissa = 8", "drawn from the model results leave float(3, 8)"),
        ('format = "single"', 'format = "single"\nfused = true', "[numerics] fused = true: the processor"),
        ('kind = "processor"', 'kind = "processor"\nwidth = 24', "[architecture] width = 24: floating-point"),
        ('kind = "processor"', 'kind = "processor"\nfraction = 9', "[architecture] fraction = 9: floating"),
        ("x = [0", "x = [1e39", "is no number of float(8, 23): take more bits for the exponent"),
    ],
)
def test_what_a_core_cannot_have_is_refused_with_its_key(old, new, message):
    with pytest.raises(DesignError) as caught:
        fitted(loads(CAR.replace(old, new)))
    assert message in str(caught.value)


def test_a_core_of_words_too_long_is_refused():
    with pytest.raises(ProgramError, match=r"float\(11, 52\) has words of 64 bits, and a core has 8 to 32"):
        Core(form=Float(11, 52))


PROGRAM = """
.text
        READ 0 A
        RECIP A 0 B
        WRITE B 0
        SCALE A -20 B
        WRITE B 0
        HALT
.data
A:
B:
"""


def test_programs_written_by_hand_run_on_floats(tmp_path):
    program, numbers = tmp_path / "p.asm", tmp_path / "n.txt"
    program.write_text(PROGRAM)
    numbers.write_text("0.1\n")

    def said(*options):
        return CliRunner().invoke(app, [*options])

    given = ("exec", str(program), "--input", str(numbers))
    done = said(*given, "--format", "single")
    assert done.stdout.split()[:2] == ["10.0", repr(float(np.float32(0.1)) * 2.0**-20)]
    done = said(*given, "--format", "7,8", "--flush")
    assert done.stdout.split()[:2] == ["10.0", repr(0.10009765625 * 2.0**-20)]
    done = said(*given)
    assert "exponent -20 is outside -16 to 14" in done.output
    assert said("asm", str(program), "--format", "8,7").exit_code == 0
    for wrong, message in (
        (("--format", "quadruple"), "one of half, single"),
        (("--format", "half", "--width", "9"), "is for fixed point"),
        (("--flush",), "is for floating point"),
    ):
        done = said(*given, *wrong)
        assert done.exit_code == 2
        assert message in " ".join(done.output.split())


@pytest.mark.skipif(not shutil.which("iverilog"), reason="no Icarus Verilog")
def test_the_test_bench_of_floats_sees_what_the_engine_says():
    text = CAR.replace('format = "single"', "exponent = 6\nmantissa = 9\nsubnormals = false")
    fit = fitted(loads(text.replace('"conventional"', '"sequential"')))
    found = bench_runs(fit, core_verilog(fit.core), drawn_rows(fit, 3), 3, Simulator.ICARUS)
    assert found.outputs == 3 * 8
