"""The parts of lee1997 are its equations, and stand beside its table."""

from random import Random

import pytest

from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.lee1997 import Figures, Speed, part_luts, reproduction
from kalmanhdl.reproduce.lee1997_parts import parts
from kalmanhdl.simulate.interpreter import interpret


def values(name: str, **inputs: int) -> dict[str, int]:
    typed = parts(LogicProduct.WALLACE)[name]
    named = {f"{key[0]}[{','.join(key[1:])}]": value for key, value in inputs.items()}
    found = interpret(typed, named, {}).values
    return {output: found[index] for output, index in typed.graph.outputs}


def test_a_part_predicts_and_divides_as_equations_14_and_17_say():
    found = values("P1A", P00=400, P01=30, P10=30, P11=3)
    side, corner = 30 + 15 * 3, 400 + 15 * 30 + 15 * (30 + 15 * 3)
    gain = 256 * corner // (corner + 3030), 256 * side // (corner + 3030)
    assert found == {
        "K[0,0]": gain[0],
        "K[1,0]": gain[1],
        "P[0,0]": corner,
        "P[0,1]": side,
        "P[1,0]": side,
        "P[1,1]": 4,
    }


def test_the_updates_are_those_of_equations_18_and_19():
    random = Random(1)
    for _ in range(50):
        K, P00, P01 = random.randrange(256), random.randrange(4000), random.randrange(4000)
        found = values("P2B", K00=K, P00=P00, P01=P01)
        assert found == {"P[0,0]": P00 - (P00 * K >> 8), "P[0,1]": P01 - (P01 * K >> 8)}
        P10, P11 = random.randrange(4000), random.randrange(4000)
        found = values("P2C", K10=K, P00=P00, P01=P01, P10=P10, P11=P11)
        assert found == {"P[1,0]": P10 - (P00 * K >> 8), "P[1,1]": P11 - (P01 * K >> 8)}
        y, x0, x1 = random.randrange(-9000, 9000), random.randrange(9000), random.randrange(-99, 99)
        found = values("P3B", z0=y, K00=K, K10=255 - K, x0=x0, x1=x1)
        assert found == {"x[0]": x0 + (y * K >> 8), "x[1]": x1 + (y * (255 - K) >> 8)}


def test_the_table_has_every_part_beside_the_papers():
    cells = facts("lee1997")["cells"]
    luts = {kind: {name: 10 * n for n, name in enumerate(cells)} for kind in LogicProduct}
    speed = Speed(nanoseconds=5.5, luts=120, multipliers=1)
    found = reproduction(Figures(luts=luts, speeds={"divider 17 by 17 to 8, radix 2": speed}))
    assert found.rows[1] == ("P1B, cells", "602", "10", "10")
    assert found.rows[9] == ("all parts, cells", "6184", "360", "360")
    assert found.rows[10] == ("divider 17 by 17 to 8, radix 2, ns", "380", "5.5", "120 LUTs, 1 DSP")


@pytest.mark.slow
def test_a_state_update_takes_fewer_cells_than_the_papers():
    assert part_luts("P3B", LogicProduct.BOOTH) < facts("lee1997")["cells"]["P3B"]
