"""A filter whose multiplications are Wallace trees says what the interpreter says, pipelined or not."""

from dataclasses import replace
from random import Random

import pytest
from devices import PLAUSIBLE
from graphs import alpha_beta
from steps import expected, random_steps, run

from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.schedule.checker import problems
from planning import planned


@pytest.mark.parametrize(("interval", "channels"), [(1, 1), (1, 16)])
def test_a_filter_of_wallace_trees_is_right(interval, channels):
    typed = replace(alpha_beta(), logic_product=LogicProduct.WALLACE)
    plan = planned(typed, PLAUSIBLE, interval, channels, multiplier_blocks=0)
    assert not problems(plan, PLAUSIBLE)
    assert not plan.on_multiplier_block
    steps = random_steps(plan, 60, Random(5))
    assert run(plan, steps, Random(6)).results == expected(plan, steps)[0]
