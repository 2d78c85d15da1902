"""Proofs of designs, held against adversaries: no proven value may leave its format, or its limits.

python benchmarks/proofs.py --steps 10000000 DESIGN.toml ...
"""

import argparse
import sys
import time
from pathlib import Path

from kalmanhdl.design import Design
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.proof.adversary import attack
from kalmanhdl.proof.prove import prove

_LENGTH, _TRACKS = 1000, 500


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("designs", nargs="+", type=Path)
    parser.add_argument("--steps", type=int, default=10_000_000)
    asked = parser.parse_args()
    wrong = 0
    for path in asked.designs:
        design, begin = Design.load(path), time.process_time()
        typed = numbers(design.model, design.algorithm, design.fixed_point).typed
        proof = prove(design.model, typed, design.fixed_point.coast)
        took = time.process_time() - begin
        broken, beyond, met = set[int](), set[int](), set[int]()
        for seed in range(-(-asked.steps // (_LENGTH * _TRACKS))):
            seen = attack(design.model, typed, proof, steps=_LENGTH, tracks=_TRACKS, seed=seed)
            met |= {k for k, count in seen.violations.items() if count}
            for k in proof.proven:
                broken |= {k} if seen.violations[k] else set()
                bound, found = proof.bounds[k], seen.extremes[k]
                beyond |= {k} if found.low < bound.low or found.high > bound.high else set()
        wrong += len(broken) + len(beyond)
        print(
            f"{path.stem}: {len(typed.violations)} values can leave their formats as such; "
            f"{len(proof.proven)} proven never to, {len(proof.reached)} reachable, "
            f"{took:.0f} s of processor; adversary left "
            f"{len(met)}, of the proven {len(broken)}, and {len(beyond)} of their limits",
            flush=True,
        )
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
