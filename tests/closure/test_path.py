"""Paths that nextpnr named are read back as what they run through."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from placer import hop

from kalmanhdl.closure.path import OPERANDS, Reader
from kalmanhdl.design import Design
from kalmanhdl.graph.operations import Multiply, Select
from kalmanhdl.pipeline import numbers_of, planned
from kalmanhdl.rtl.names import operation_names
from kalmanhdl.schedule.storage import ports

DESIGNS = Path(__file__).parents[2] / "designs"


@cache
def planned_design(name, mhz, lanes=1):
    design = Design.load(DESIGNS / f"{name}.toml")
    design = replace(design, architecture=replace(design.architecture, clock_mhz=mhz, lanes=lanes))
    return planned(design, numbers_of(design)), design.target.part


def read(name, mhz, *path):
    return Reader(*planned_design(name, mhz)).read(path)


# As nextpnr 0.11 told them of these designs, without the carry chains.
DIVIDER = (
    hop("clk-to-q", "datapath.divisor_TRELLIS_FF_Q_4", 0.525),
    hop(
        "routing",
        "datapath.update_K_0_0_term_divider.partial_3_0_TRELLIS_FF_Q_5_DI_CCU2C_S0_A1_CCU2C_S0_B1_LUT4_Z",
        0.891,
        "datapath.divisor[3]",
    ),
    hop("logic", "datapath.update_K_0_0_term_divider.partial_3_0_TRELLIS_FF_Q_5_DI_CCU2C_S0", 0.683),
    hop(
        "routing",
        "$nextpnr_CCU2C_20$CCU2_COMB0",
        1.202,
        "datapath.update_K_0_0_term_divider.bits_3_0_TRELLIS_FF_Q_1_DI",
    ),
    hop("logic", "$nextpnr_CCU2C_20$CCU2_COMB0", 0.447),
    hop("setup", "datapath.update_K_0_0_term_divider.bits_3_0_TRELLIS_FF_Q", 0.0),
)
CHAIN = (
    hop("clk-to-q", "datapath.product_MULT18X18D_P9", 0.578),
    hop("routing", "context_r10_w17._0__LUT4_A_D_LUT4_Z_D_LUT4_Z", 1.325, "datapath._112_[15]"),
    hop("logic", "context_r10_w17._0__LUT4_A_D_LUT4_Z_D_LUT4_Z", 0.18),
    hop("routing", "datapath.a$174_TRELLIS_FF_Q_11_DI_LUT4_Z", 0.974, "context_r10_w17._0__LUT4_A_D[3]"),
    hop("routing", "datapath.posterior_P_0_1_term_c11_TRELLIS_FF_Q_7", 0.265, "datapath.posterior_P_0_1"),
    hop("setup", "datapath.posterior_P_0_1_term_c11_TRELLIS_FF_Q_7", 0.0),
)
UNIT = (
    hop("clk-to-q", "datapath.multiply_0.core.a_TRELLIS_FF_Q_10", 0.395),
    hop(
        "routing",
        "datapath.multiply_0.core.product_0_0_MULT18X18D_P9",
        1.369,
        "datapath.multiply_0.core.a[10]",
    ),
    hop("logic", "datapath.multiply_0.core.product_0_0_MULT18X18D_P9", 3.066),
    hop(
        "routing",
        "datapath.initialise_x_1_c3_TRELLIS_FF_Q_10",
        1.219,
        "datapath.multiply_0.core.product_0_0[21]",
    ),
    hop("setup", "datapath.initialise_x_1_c3_TRELLIS_FF_Q_10", 0.0),
)
CHOICE = (
    hop("clk-to-q", "datapath.control_store_TRELLIS_FF_Q", 0.395),
    hop("routing", "datapath.multiply_1_operand_0_file_0.x_DPR16X4C", 0.8, "datapath.control_store[3]"),
    hop("setup", "datapath.multiply_1.core.a_TRELLIS_FF_Q_3", 0.0),
)


def test_a_path_inside_a_divider_is_the_divider():
    found = read("nile", 150.0, *DIVIDER)
    assert [part.kind for part in found.parts] == ["reciprocal"]
    assert found.parts[0].name == "update: K[0,0] term"
    assert found.measured_ns == pytest.approx(3.748)


def test_logic_named_by_the_register_that_it_drives_is_read_back_by_the_schedule():
    plan, part = planned_design("lee1997", 250.0)
    names = operation_names(plan.typed.graph)
    end = names.index("posterior_P_0_1_term")
    path = (*CHAIN[:-1], hop("setup", f"datapath.{names[end]}_c{plan.end(end) + 1}_TRELLIS_FF_Q_7", 0.0))
    found = Reader(plan, part).read(path)
    assert [one.kind for one in found.parts] == ["quantise", "select"]
    assert end in found.operations
    assert sum(one.delay_ns for one in found.parts) == pytest.approx(found.measured_ns - 0.578, abs=0.01)


def test_a_path_through_a_shared_operator_is_its_kind():
    assert [part.kind for part in read("kumar2014_time_multiplexed", 200.0, *UNIT).parts] == ["multiply"]


def test_a_path_to_the_operands_of_a_shared_operator_is_their_choice():
    found = read("kumar2014_time_multiplexed", 200.0, *CHOICE)
    assert [part.kind for part in found.parts] == [OPERANDS]


def test_a_path_into_a_file_is_what_the_file_keeps():
    plan, part = planned_design("kumar2014_time_multiplexed", 200.0)
    unit, number, file = next(
        (f"{unit.kind}_{k}", number, file)
        for k, unit in enumerate(plan.units)
        for number, port in enumerate(ports(plan, unit))
        for file in range(len(port.files))
    )
    end = f"datapath.{unit}_operand_{number}_file_{file}.memory_DPR16X4C"
    found = Reader(plan, part).read((hop("clk-to-q", "datapath.product$3", 0.4), hop("setup", end, 3.0)))
    assert found.parts
    assert OPERANDS not in [one.kind for one in found.parts]


@pytest.mark.parametrize(
    "cell", ["issue.room_TRELLIS_FF_Q", "credits.count_TRELLIS_FF_Q_2", "_0__TRELLIS_FF_Q"]
)
def test_a_path_outside_of_the_datapath_says_nothing(cell):
    assert read("nile", 150.0, hop("clk-to-q", "entrance.full", 0.5), hop("setup", cell, 1.0)).parts == ()


def test_operands_that_a_multiplier_block_keeps_are_their_choice_too():
    block = "datapath.multiply_1.core.product_0_0_MULT18X18D_P9"
    path = (*CHOICE[:-1], hop("setup", block, 0.2))
    assert [part.kind for part in read("kumar2014_time_multiplexed", 200.0, *path).parts] == [OPERANDS]


def test_a_register_that_a_multiplier_block_keeps_is_found_from_the_beginning():
    plan, part = planned_design("lee1997", 250.0)
    names, operations = operation_names(plan.typed.graph), plan.typed.graph.operations
    product, factor = next(
        (k, a)
        for k, operation in enumerate(operations)
        if isinstance(operation, Multiply) and k in plan.on_multiplier_block
        for a in (operation.a, operation.b)
        if isinstance(operations[a], Select) and plan.end(a) < plan.start[k]
    )
    chosen = operations[factor]
    source = next(k for k in (chosen.a, chosen.b) if plan.end(k) < plan.start[factor])
    path = (
        hop("clk-to-q", f"datapath.{names[source]}_c{plan.start[factor]}_TRELLIS_FF_Q_3", 0.4),
        hop("routing", "datapath.product$12_MULT18X18D_P3", 1.4, "datapath.a$12[3]"),
        hop("setup", "datapath.product$12_MULT18X18D_P3", 0.3),
    )
    assert factor in Reader(plan, part).read(path).operations
    assert product not in Reader(plan, part).read(path).operations


def test_lanes_are_read_as_the_one_that_they_repeat():
    plan, part = planned_design("nile", 150.0)
    inside = [
        replace(each, cell=f"lane_1.{each.cell}", net=each.net and f"lane_1.{each.net}") for each in DIVIDER
    ]
    assert Reader(plan, part).read(inside).parts == Reader(plan, part).read(DIVIDER).parts


def test_no_path_is_no_reading():
    assert read("nile", 150.0).parts == ()
