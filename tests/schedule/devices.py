"""Devices made by hand: one where every piece of logic takes a nanosecond, one much like a real part."""

from kalmanhdl.target.device import Device

KINDS = (
    "add", "multiply", "compare", "select", "table", "shift", "leading_one",
    "context_read", "context_write", "register",
)  # fmt: skip


def _device(name: str, period: float, delays: dict[str, tuple[tuple[int, float], ...]]) -> Device:
    return Device(
        name=name,
        grade=8,
        family="none",
        luts=24_000,
        ffs=24_000,
        multipliers=28,
        block_rams=56,
        multiplier_width=18,
        pipelined_period_ns=period,
        delays=delays,
        areas={},
        measured_with="made by hand",
    )


UNIT = _device("unit", 1.0, {kind: ((1, 0.0 if kind == "register" else 1.0),) for kind in KINDS})

PLAUSIBLE = _device(
    "plausible",
    6.0,
    {
        "add": ((8, 1.3), (16, 1.7), (32, 2.5)),
        "multiply": ((18, 4.2),),
        "compare": ((4, 0.9), (16, 1.5)),
        "select": ((1, 0.7), (16, 0.9)),
        "table": ((4, 0.8), (8, 2.0)),
        "shift": ((8, 2.0), (16, 2.7), (32, 3.4)),
        "leading_one": ((8, 1.8), (16, 2.4), (32, 3.0)),
        "context_read": ((1, 4.0),),
        "context_write": ((1, 0.3),),
        "register": ((1, 0.9),),
    },
)
