"""Every error that kalmanhdl raises on purpose.

KalmanhdlError
├── DesignError         a design file or a design object says something that cannot be
│   └── ModelError      the model itself: shapes, symmetry, definiteness, initialisation
├── DataError           a table of measurements cannot be used
├── FormatError         a number does not fit the format that it was given
├── ScheduleError       no schedule satisfies the architecture asked for
├── ProgramError        a program of the processor cannot be assembled, loaded or run
├── ToolError           an external tool is missing or failed
├── VerificationError   the Verilog and the bit-exact engine differ
└── OutputError         a result cannot be written where it was asked for
"""


class KalmanhdlError(Exception):
    """The root: catching it catches every error raised on purpose, and no defect.

    ``table`` and ``key`` of a design are what it is about, where one is known: a file can add the line.
    """

    def __init__(self, *message: object, table: str = "", key: str = "") -> None:
        self.table, self.key = table, key
        super().__init__(*message)


class DesignError(KalmanhdlError):
    """A design says something that cannot be."""


class ModelError(DesignError):
    """The model is not a valid state-space model."""


class DataError(KalmanhdlError):
    """A table of measurements cannot be used."""


class FormatError(KalmanhdlError):
    """A number does not fit the format that it was given."""


class ScheduleError(KalmanhdlError):
    """No schedule satisfies the architecture asked for."""


class ProgramError(KalmanhdlError):
    """A program of the processor cannot be assembled, loaded or run."""


class ToolError(KalmanhdlError):
    """An external tool is missing or failed."""


class VerificationError(KalmanhdlError):
    """The Verilog and the bit-exact engine differ."""


class OutputError(KalmanhdlError):
    """A result cannot be written where it was asked for."""
