"""Numbers as a reader wants them: few digits, a prefix where they are large."""

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"))
MISSING = "–"
_MINUS = "−"


def number(value: float | int | str | None, digits: int = 4) -> str:
    """A number in so many significant digits; whole ones in full, grouped by thousands."""
    if value is None:
        return MISSING
    if isinstance(value, str | bool):
        return str(value)
    if isinstance(value, int) or (float(value).is_integer() and abs(value) < 1e9):
        return f"{int(value):,}".replace(",", "\u202f").replace("-", _MINUS)
    return _plain(value, digits)


def prefixed(value: float | None, unit: str, digits: int = 4) -> str:
    """A number with a prefix and its unit, such as ``165.3 M/s``."""
    if value is None:
        return MISSING
    for size, prefix in _PREFIXES:
        if abs(value) >= size:
            return f"{_plain(value / size, digits)} {prefix}{unit}"
    return f"{_plain(value, digits)} {unit}".rstrip()


def percent(value: float | None, digits: int = 2) -> str:
    """A ratio in per cent, with its sign."""
    return MISSING if value is None else f"{100 * value:+.{digits}f} %".replace("-", _MINUS)


def _plain(value: float, digits: int) -> str:
    text = f"{value:.{digits}g}".replace("-", _MINUS, value < 0)
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    if 0 < int(exponent) < 6:
        return f"{value:.0f}"
    superscript = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa} · 10{superscript}"
