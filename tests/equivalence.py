"""Whether a changed Verilog still does the same: proven by Yosys, wire by wire."""

import re

from invariant import assumed
from kalmanhdl.errors import ToolError
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.toolchain.yosys import run_script

# Rounds in which wires that differ, but need not matter, are taken out of the comparison.
_ROUNDS = 12
# Clock cycles that a proof may look back over.
_BACK = 2
_UNPROVEN = re.compile(r"^ *Unproven \$equiv \S+: \\(.+?)_gold(?: |$)", re.MULTILINE)


def proof(verilog: str, changed: str, top: str, typed: TypedGraph | None = None) -> str:
    """How both are proven to give the same outputs and kept wires for all inputs; empty where they are not.

    Both are cut at all wires of the same name, and each wire is proven to be the same function of those
    before it and of the registers, which start alike. A wire inside that differs is no longer cut at, but
    looked through, in the next round; the proof stands when nothing is left to prove.

    Bits that are always zero, by the bounds of what the graph ``typed`` computes, may be read as such, of
    wires that are the same in both.
    """
    assuming: frozenset[str] = frozenset()
    if typed is not None:
        (verilog, known), (changed, also_known) = assumed(verilog, typed), assumed(changed, typed)
        assuming = known | also_known
    bounded = {name.removesuffix("_known") for name in assuming}
    watched = set(re.findall(r"\(\* keep = .*?\*\)\n +wire (?:\[\d+:0\] )?(\S+);", verilog))
    outputs = set(re.findall(r"^  output (?:\[\d+:0\] )?(\S+);", verilog.split("endmodule")[0], re.MULTILINE))
    through: set[str] = set()
    for _ in range(_ROUNDS):
        unproven, count, points = _compared(verilog, changed, top, through | assuming)
        if not count:
            return f"{points} bits are the same function" + (
                f", {len(through)} inner wires are not" if through else ""
            )
        if not unproven or unproven & (watched | outputs | bounded) or unproven <= through:
            return ""
        through |= unproven
    return ""


def _compared(verilog: str, changed: str, top: str, through: set[str]) -> tuple[set[str], int, int]:
    """The wires that are not proven the same, how many bits are not, and how many were compared."""
    read = [
        command
        for name in ("gold", "gate")
        for command in (
            f"read_verilog {name}.v",
            f"hierarchy -check -top {top}",
            "proc",
            "flatten",
            "memory_collect",
            "memory_map -rom-only",
            "opt_clean -purge",
            f"rename {top} {name}",
            f"design -stash {name}",
        )
    ]
    commands = [
        *read,
        "design -copy-from gold -as gold gold",
        "design -copy-from gate -as gate gate",
        "equiv_make -blacklist through.txt gold gate equiv",
        "hierarchy -top equiv",
        "equiv_struct -fwd",
        # Memories with equal inputs are one by now, and may give anything; of others nothing is proven.
        "delete t:$mem_v2",
        "equiv_simple -short",
        f"equiv_simple -seq {_BACK}",
        "tee -q -o status.txt equiv_status",
    ]
    inputs = {
        "gold.v": verilog,
        "gate.v": changed,
        "through.txt": "".join(f"\\{w}\n" for w in sorted(through)),
    }
    try:
        status = run_script(commands, inputs, "status.txt")
    except ToolError as error:
        # Latches, where a register was taken out of a loop: of them nothing is proven.
        if "No SAT model" in str(error):
            return set(), 1, 0
        raise
    found = re.search(r"Found (\d+) \$equiv cells.*?(\d+) are unproven", status, re.DOTALL)
    if found is None:
        raise ToolError(f"equiv_status of Yosys says something else than expected: {status[:200]!r}")
    return set(_UNPROVEN.findall(status)), int(found[2]), int(found[1])
