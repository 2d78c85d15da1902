"""Floating-point operators against NumPy and the C library, on millions of vectors an operation.

    python benchmarks/float_vectors.py                    1e7 vectors an operation, single and half precision
    python benchmarks/float_vectors.py --vectors 100000   fewer
    python benchmarks/float_vectors.py --seed 7           others

The vectors are those of ``tests/float_vectors.py``: as in Berkeley TestFloat, mostly cases that go wrong. The
hardware runs as the Verilog that a user gets, compiled by CXXRTL. A sample of each run is also computed by
``arithmetic.floating``, on exact fractions. Exits with 1 at any difference.
"""

import argparse
import ctypes
import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).parent.parent / "tests"))

import numpy as np

import float_vectors
from core_runs import CompiledCores
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.adder import FloatAdder
from kalmanhdl.rtl.floating.comparer import FloatComparer
from kalmanhdl.rtl.floating.converters import FixedToFloat, FloatToFixed
from kalmanhdl.rtl.floating.divider import FloatDivider
from kalmanhdl.rtl.floating.fused import FloatFused
from kalmanhdl.rtl.floating.multiplier import FloatMultiplier
from kalmanhdl.rtl.floating.scaler import FloatScaler
from kalmanhdl.rtl.floating.square_root import FloatSquareRoot
from kalmanhdl.rtl.floating.wrapper import FloatWrapper
from kalmanhdl.toolchain.cxxrtl import find_compiler
from kalmanhdl.toolchain.process import run, working_folder

CHUNK = 500_000
SAMPLE = 2000
TYPES = {Float(8, 23): (np.float32, np.uint32), Float(5, 10): (np.float16, np.uint16)}
# Two halves multiply to a whole multiple of 2**-48 below 2**32, so that an exact sum fits in 128 bits.
_FUSED = """
#include <math.h>
#include <stdint.h>
#include <string.h>
void fused_32(const float *a, const float *b, const float *c, float *out, long count)
{ for (long k = 0; k < count; k++) out[k] = fmaf(a[k], b[k], c[k]); }
void fused_16(const double *a, const double *b, const double *c, double *out, long count)
{
    for (long k = 0; k < count; k++) {
        double product = a[k] * b[k], sum = product + c[k];
        if (isfinite(sum)) {
            /* Rounded to odd, a double has bits enough to be rounded to half precision once more. */
            double part = sum - product, error = (product - (sum - part)) + (c[k] - part);
            uint64_t bits;
            memcpy(&bits, &sum, 8);
            if (error != 0 && !(bits & 1)) bits += (error > 0) == (sum > 0) ? 1 : -1;
            memcpy(&sum, &bits, 8);
        }
        out[k] = sum;
    }
}
"""


def cores(form: Float) -> dict:
    return {
        "add": FloatAdder(form, 6),
        "subtract": FloatAdder(form, 5, difference=True),
        "multiply": FloatMultiplier(form, 4),
        "divide": FloatDivider(form, 13),
        "square_root": FloatSquareRoot(form, 11),
        "scale_up": FloatScaler(form, 3, 2),
        "scale_down": FloatScaler(form, -5, 1),
        "fused": FloatFused(form, 9),
        "wrap": FloatWrapper(form, 3),
        "compare": FloatComparer(form, 1),
        "to_fixed": FloatToFixed(form, fixed_of(form), 3),
        "from_fixed": FixedToFloat(fixed_of(form), form, 3),
    }


def fixed_of(form: Float) -> Fixed:
    """The fixed-point format that numbers are converted to and from, as wide as theirs."""
    return Fixed(width=form.width, fraction=form.width // 3)


class Oracle:
    """What NumPy and the C library give, as raw integers with the one NaN."""

    def __init__(self, form: Float, folder: Path) -> None:
        self.form, (self.number, self.integer) = form, TYPES[form]
        (folder / "fused.c").write_text(_FUSED)
        flags = (
            "-x",
            "c",
            "-O2",
            "-ffp-contract=off",
            "-shared",
            "-fPIC",
            "fused.c",
            "-o",
            "fused.so",
            "-lm",
        )
        run(find_compiler(), flags, folder)
        self.library = ctypes.CDLL(str(folder / "fused.so"))

    def results(self, a, b, c) -> dict[str, np.ndarray]:
        x, y, z = (each.astype(self.integer).view(self.number) for each in (a, b, c))
        with np.errstate(all="ignore"):
            found = {name: getattr(np, name)(x, y) for name in ("add", "subtract", "multiply", "divide")}
            found["square_root"] = np.sqrt(x)
            found["scale_up"], found["scale_down"] = np.ldexp(x, 3), np.ldexp(x, -5)
            found["fused"] = self.fused(x, y, z)
            rest = x - np.rint(x)
            found["wrap"] = np.where(rest == 0.5, self.number(-0.5), rest)
            found["from_fixed"] = self.from_fixed(a)
            exact = {"compare": compared_bits(x, y), "to_fixed": self.to_fixed(x)}
        return exact | {name: self.raws(values) for name, values in found.items()}

    def to_fixed(self, x):
        """Doubles hold every number of the format times a power of two, and the limits."""
        fixed = fixed_of(self.form)
        scaled = np.nan_to_num(x.astype(np.float64), nan=0.0, posinf=np.inf, neginf=-np.inf)
        raws = np.clip(np.rint(scaled * 2.0**fixed.fraction), fixed.lowest, fixed.highest)
        return raws.astype(np.int64).astype(np.uint64) & np.uint64((1 << fixed.width) - 1)

    def from_fixed(self, raws):
        """Doubles hold every number of the fixed-point format."""
        fixed = fixed_of(self.form)
        signed = raws.astype(np.int64) - (raws >> np.uint64(fixed.width - 1)).astype(np.int64) * (
            1 << fixed.width
        )
        return (signed * 2.0**-fixed.fraction).astype(self.number)

    def fused(self, *operands):
        wide = np.float32 if self.number is np.float32 else np.float64
        arrays = [np.ascontiguousarray(each, wide) for each in operands]
        out = np.empty_like(arrays[0])
        call = self.library.fused_32 if wide is np.float32 else self.library.fused_16
        call(*(each.ctypes.data_as(ctypes.c_void_p) for each in (*arrays, out)), ctypes.c_long(len(out)))
        return out.astype(self.number)

    def raws(self, values):
        return np.where(np.isnan(values), self.form.nan, values.view(self.integer)).astype(np.uint64)


def compared_bits(x, y):
    """The bits that ``FloatComparer`` sets."""
    flags = (x < y, x == y, x > y, np.isnan(x) | np.isnan(y))
    return sum(flag.astype(np.uint64) << np.uint64(place) for place, flag in enumerate(flags))


def compared(form: Float, vectors: int, seed: int) -> int:
    """The differences of all operations on so many vectors each."""
    built = cores(form)
    wrong = dict.fromkeys(built, 0)
    begin = time.perf_counter()
    compiled = CompiledCores(built, optimised=True)
    with working_folder() as folder:
        oracle = Oracle(form, Path(folder))
        for first in range(0, vectors, CHUNK):
            count = min(CHUNK, vectors - first)
            operands = float_vectors.operands(form, count, seed + first, 3)
            found, expected = compiled.results(*operands), oracle.results(*operands)
            for name in built:
                unequal = np.flatnonzero(found[name] != expected[name])
                wrong[name] += len(unequal)
                for k in unequal[:3]:
                    shown = ", ".join(hex(each[k]) for each in operands)
                    print(f"{name}({shown}): {hex(found[name][k])}, not {hex(expected[name][k])}")
                wrong[name] += against_fractions(
                    built[name], operands, found[name], SAMPLE if not first else 0
                )
    seconds = time.perf_counter() - begin
    for name, count in wrong.items():
        print(f"{form} {name}: {vectors} vectors, {count} mismatches", flush=True)
    print(f"{form}: {seconds:.0f} s", flush=True)
    return sum(wrong.values())


def against_fractions(core, operands, found, count: int) -> int:
    """The differences of the first vectors from ``arithmetic.floating``."""
    ports = [k for k, port in enumerate("abc") if hasattr(core, port)]
    rows = zip(*(operands[k][:count].tolist() for k in ports), strict=True)
    return sum(core.compute(*row) != value for row, value in zip(rows, found.tolist(), strict=False))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vectors", type=int, default=10_000_000, help="an operation")
    parser.add_argument("--seed", type=int, default=1, help="of the vectors")
    parser.add_argument("--format", choices=["single", "half"], help="one of the two")
    given = parser.parse_args()
    forms = {"single": Float(8, 23), "half": Float(5, 10)}
    chosen = [form for name, form in forms.items() if given.format in (None, name)]
    if sum(compared(form, given.vectors, given.seed) for form in chosen):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
