"""SymPy expressions as the strings of ``model.expression``. SymPy is not imported: attributes are read."""

from typing import Any

_NAMED = ("sqrt", "exp", "sin", "cos", "tan", "atan2", "hypot", "wrap")


def text_of(entry: Any) -> str | None:
    """The string for a number or a SymPy expression, None for anything else."""
    if isinstance(entry, bool):
        return None
    if not hasattr(entry, "free_symbols"):
        try:
            return repr(float(entry))
        except (TypeError, ValueError, OverflowError):
            return None
    if entry.is_Symbol:
        return str(entry.name)
    if entry.is_Integer:
        return f"({int(entry)})"
    if entry.is_Rational:
        return f"({entry.p}/{entry.q})"
    if entry.is_number and not entry.args:
        return f"({float(entry)!r})"
    parts = [text_of(argument) for argument in entry.args]
    written = [part for part in parts if part is not None]
    return _joined(entry, written) if written and len(written) == len(parts) else None


def _joined(entry: Any, parts: list[str]) -> str | None:
    if entry.is_Add:
        return f"({' + '.join(parts)})"
    if entry.is_Mul:
        return "*".join(parts)
    if entry.is_Pow:
        return f"({parts[0]})^{parts[1]}"
    name = type(entry).__name__
    return f"{name}({', '.join(parts)})" if name in _NAMED else None
