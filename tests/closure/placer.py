"""A stand-in for place and route: logic takes so many times the delay of the device's table, by kind.

It finds the longest stage of a plan by a walk of its own and names it as Yosys and nextpnr would.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from kalmanhdl.graph.operations import Constant, Divide, Multiply, Reciprocal, operands
from kalmanhdl.pipeline import Hardware, Implemented
from kalmanhdl.rtl.names import operation_names
from kalmanhdl.schedule.operators import operators
from kalmanhdl.target import Device
from kalmanhdl.toolchain.nextpnr import Hop, Implementation


def placed(fmax_mhz: float, path: tuple[Hop, ...], seed: int = 1) -> Implementation:
    return Implementation(
        device="ecp5-25k",
        grade=8,
        seed=seed,
        tool="by hand",
        fmax_mhz=fmax_mhz,
        luts=1,
        ffs=1,
        multipliers=1,
        block_rams=0,
        seconds=1.0,
        critical_path=path,
    )


def hop(kind: str, cell: str, delay_ns: float, net: str = "") -> Hop:
    return Hop(kind=kind, cell=cell, port="Q", net=net, delay_ns=delay_ns)


@dataclass
class Placer:
    """Calls are ``place(hardware, progress)``; the plans that were placed are kept."""

    truth: Mapping[str, float]
    plans: list[object] = field(default_factory=list)

    def __call__(self, hardware: Hardware, progress: object) -> Implemented:
        self.plans.append(hardware.plan)
        delay, path = self._longest(hardware)
        return Implemented(placements=(placed(1000 / delay, path),), seconds={"place_and_route": 1.0})

    def _longest(self, hardware: Hardware) -> tuple[float, tuple[Hop, ...]]:
        plan, part = hardware.plan, replace(hardware.design.target.part, derate={})
        library = operators(plan.typed, part, plan.on_multiplier_block, plan.sharing)
        names = operation_names(plan.typed.graph)
        unit = {k: f"{unit.kind}_{n}" for n, unit in enumerate(plan.units) for k in unit.operations}
        # The factors of the design let it hold more registers than the table alone has room for.
        stages = [
            (*o.stages(min(held, o.capacity)), *(0,) * (held - o.capacity))
            for o, held in zip(library, plan.registers, strict=True)
        ]
        longest, path = 0.0, ()
        arrival: list[float] = []
        for index, operation in enumerate(plan.typed.graph.operations):
            factor = self.truth.get(library[index].kind, 1.0) / 1000
            before = [
                arrival[k]
                for k in operands(operation)
                if plan.end(k) == plan.start[index]
                and not isinstance(plan.typed.graph.operations[k], Constant)
            ]
            chained = 0.0 if plan.registers[index] else max(before, default=0.0)
            arrival.append(chained + stages[index][-1] * factor)
            inner = max(stages[index]) * factor if plan.registers[index] else 0.0
            if inner > longest and isinstance(operation, Multiply | Divide | Reciprocal):
                inside = f"{unit[index]}.core" if index in unit else f"{names[index]}_divider"
                longest, path = inner, _inside(inside, inner)
            if arrival[index] > longest:
                longest = arrival[index]
                path = _to_register(f"{names[index]}_c{plan.end(index) + 1}", longest)
        register = _register(part)
        return longest + register, (replace(path[0], delay_ns=register), *path[1:])


def _register(part: Device) -> float:
    return part.delay_ns("register", 1)


def _inside(core: str, delay: float) -> tuple[Hop, ...]:
    register = f"datapath.{core}.partial_3_0_TRELLIS_FF_Q"
    return (
        hop("clk-to-q", f"{register}_5", 0.0),
        hop("routing", f"{register}_5_DI_LUT4_Z", delay / 2, f"{register}_5_DI"),
        hop("logic", f"{register}_5_DI_LUT4_Z", delay / 2),
        hop("setup", f"{register}_7", 0.0),
    )


def _to_register(register: str, delay: float) -> tuple[Hop, ...]:
    """As Yosys names it: by the register that is driven, and by aliases of no meaning."""
    return (
        hop("clk-to-q", "datapath.product_MULT18X18D_P9", 0.0),
        hop("routing", "context_r10_w17._0__LUT4_A", delay / 2, "datapath._112_[15]"),
        hop("logic", f"datapath.{register}_TRELLIS_FF_Q_7_DI_LUT4_Z", delay / 2),
        hop("setup", f"datapath.{register}_TRELLIS_FF_Q_7", 0.0),
    )
