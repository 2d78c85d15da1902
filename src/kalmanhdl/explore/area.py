"""An estimate of the area of a step under formats, before anything is scheduled or synthesised.

One operator for each operation. An adder or a choice costs a LUT a bit, a rounding that can leave its
format two; a multiplication costs the multiplier blocks of its limbs, or, where an operand is narrow, its
rows of adders. A block counts as many LUTs as the device has for each of its blocks.
"""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.product_structure import booth_rows, limb_widths
from kalmanhdl.explore.format_engine import Run
from kalmanhdl.explore.program import Code, Program
from kalmanhdl.target.device import Device

# A multiplication of so few rows costs less in logic than the way to a block.
_ROWS_IN_LOGIC = 4


def estimated_luts(program: Program, run: Run, device: Device) -> float:
    """LUTs, those that stand for multiplier blocks included."""
    types, total = run.types, 0.0
    per_block = device.luts / max(device.multipliers, 1)
    for index in np.flatnonzero(types["live"]).tolist():
        step, width = program.steps[index], int(types["width"][index])
        match step.code:
            case Code.ADD | Code.SUBTRACT | Code.SELECT:
                total += width
            case Code.SCALE:
                total += width * (_digits(types["value"][index]) - 1)
            case Code.QUANTISE:
                total += 2 * width * int(types["leaves"][index])
            case Code.MULTIPLY:
                total += _product(types, int(types["at"][step.a]), int(types["at"][step.b]), per_block)
            case Code.DIVIDE | Code.RECIPROCAL:
                total += width * (width + 2)
            case _:
                pass
    return total


def _product(types: NDArray[np.void], a: int, b: int, per_block: float) -> float:
    (x, p), (y, q) = ((int(types["width"][k]), bool(types["low"][k] < 0)) for k in (a, b))
    rows = min(booth_rows(x, p), booth_rows(y, q))
    if rows <= _ROWS_IN_LOGIC:
        return float(rows * max(x, y))
    return per_block * len(limb_widths(x, p, q)) * len(limb_widths(y, q, p))


def _digits(value: float) -> int:
    """The signed digits of a constant."""
    magnitude = abs(int(np.ldexp(np.frexp(value)[0], 53)))
    return ((3 * magnitude) ^ magnitude).bit_count()
