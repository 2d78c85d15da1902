"""What every check of user input shares: how a wrong value is named, and what a name may be."""

import difflib
import re
import reprlib
from collections.abc import Iterable, Mapping, Sequence, Set
from numbers import Integral, Real
from operator import index
from typing import Any

from kalmanhdl.errors import DesignError, ModelError

MAX_NAME_LENGTH = 64
MAX_HINTS = 16
_LONGEST_KEY = 200

_VERILOG = """
always and assign automatic begin bit buf bufif0 bufif1 byte case casex casez cell class cmos config const
deassign default defparam design disable do edge else end endcase endclass endconfig endfunction endgenerate
endinterface endmodule endpackage endprimitive endprogram endspecify endtable endtask enum event export extern
final for force forever fork function generate genvar highz0 highz1 if ifnone import incdir include initial
inout input instance int integer interface join large liblist library localparam logic longint macromodule
medium module nand negedge nmos nor noshowcancelled not notif0 notif1 or output package packed parameter pmos
posedge primitive priority program property pull0 pull1 pulldown pullup pulsestyle_ondetect
pulsestyle_onevent pure rand rcmos real realtime ref reg release repeat return rnmos rpmos rtran rtranif0
rtranif1 scalared sequence shortint shortreal showcancelled signed small solve specify specparam static string
strong0 strong1 struct super supply0 supply1 table tagged task this time timeprecision timeunit tran tranif0
tranif1 tri tri0 tri1 triand trior trireg type typedef union unique unsigned use var vectored virtual void
wait wand weak0 weak1 while wire with within wor xnor xor
"""
VERILOG_WORDS = frozenset(_VERILOG.split())
"""Words of Verilog and SystemVerilog that no module may be called by (IEEE 1364-2005, 1800-2009)."""

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")


class KalmanhdlWarning(UserWarning):
    """Something in a design is allowed, but hardly meant."""


class InvalidValueError(DesignError):
    """A value of a design is wrong. Carries the table and the key, so that a file can add the line."""

    def __init__(self, table: str, key: str, problem: str) -> None:
        self.problem = problem
        # A key may be the user's own word, as those of tables of operators or of signals are.
        name = key if key.isprintable() and len(key) <= _LONGEST_KEY else shown(key)
        super().__init__(f"{f'[{table}] ' if table else ''}{name}{problem}", table=table, key=key)


class InvalidModelValueError(InvalidValueError, ModelError):
    """A value of the model is wrong."""


def as_integer(value: object) -> int | None:
    """The integer that a value is, NumPy's and floats without a fraction included; None for anything else."""
    if isinstance(value, Integral) and not isinstance(value, bool):
        return index(value)
    number = as_real(value)
    return int(number) if number is not None and number.is_integer() else None


def as_real(value: object) -> float | None:
    """The float that a number is, NumPy's included, infinite if it is too large; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def as_flag(value: object) -> bool | None:
    """The truth that a value is, NumPy's included; None for anything else."""
    if isinstance(value, bool):
        return value
    scalar: Any = value
    is_truth = getattr(value, "ndim", None) == 0 and str(getattr(value, "dtype", "")) == "bool"
    return bool(scalar) if is_truth else None


def as_tuple(value: object) -> tuple[Any, ...] | None:
    """The elements of a list, an array or the like in their order; None for anything else, texts too."""
    if isinstance(value, str | bytes | Mapping | Set) or not isinstance(value, Iterable):
        return None
    try:
        return tuple(value)
    except TypeError:
        # An array of no dimension says that it is iterable.
        return None


def integer(table: str, key: str, value: object, low: int, high: int) -> int:
    """The integer of a key. Raises DesignError where it is none, or outside of its limits."""
    found = as_integer(value)
    if found is None or not low <= found <= high:
        raise InvalidValueError(table, key, f" = {shown(value)}: an integer from {low} to {high}")
    return found


def flag(table: str, key: str, value: object) -> bool:
    """The truth of a key. Raises DesignError where it is none."""
    found = as_flag(value)
    if found is None:
        raise InvalidValueError(table, key, f" = {shown(value)}: true or false")
    return found


def shown(value: object) -> str:
    """A value in a message: short and on one line, whatever it is."""
    if isinstance(value, Real | str) and (item := getattr(value, "item", None)):
        # What is NumPy's reads like any other.
        value = item()
    if isinstance(value, float):
        return f"{value:.6g}"
    brief = reprlib.Repr()
    brief.maxstring = brief.maxother = brief.maxlong = 60
    brief.maxlist = brief.maxdict = brief.maxtuple = 4
    brief.maxlevel = 2
    text = brief.repr(value)
    # A string's blanks are what a user wrote; what others say of themselves may have several lines.
    return text if isinstance(value, str) else " ".join(text.split())


def close(word: str, valid: Iterable[str]) -> str | None:
    """The valid word that a word resembles, or None."""
    found = difflib.get_close_matches(word[:MAX_NAME_LENGTH], valid, n=1, cutoff=0.5)
    return found[0] if found else None


def nearest(word: str, valid: Iterable[str]) -> str:
    """A hint that ends a message: the nearest valid word, or the first valid ones."""
    words = list(valid)
    meant = close(word, words)
    if meant is not None:
        return f"did you mean {meant!r}?"
    if len(words) == 1:
        return f"only {words[0]!r} is valid"
    rest = ", ..." if len(words) > MAX_HINTS else ""
    return f"valid are {', '.join(words[:MAX_HINTS])}{rest}" if words else "none is valid here"


def identifier_problem(name: object) -> str | None:
    """Why a value is no name for files, columns and Verilog, or None."""
    if not isinstance(name, str):
        return f"{shown(name)} is no name: write a string"
    if len(name) > MAX_NAME_LENGTH:
        return f"{shown(name)} has {len(name)} characters: a name has at most {MAX_NAME_LENGTH}"
    if not _IDENTIFIER.match(name):
        return f"{shown(name)} is no name: use letters, digits and _, and begin with a letter or _"
    return None


def names_problem(names: Sequence[object]) -> str | None:
    """Why a list is no list of distinct names, or None."""
    seen: set[object] = set()
    for name in names:
        problem = identifier_problem(name)
        if problem:
            return problem
        if name in seen:
            return f"{shown(name)} stands twice: give every one its own name"
        seen.add(name)
    return None
