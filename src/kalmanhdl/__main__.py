"""The command's door, and ``python -m kalmanhdl``."""

import sys

from kalmanhdl.interruption import INTERRUPTED, Interrupted, catch_signals


def main() -> None:
    """Run the command; Ctrl-C ends it with one line even while it is still being imported."""
    try:
        catch_signals()
        from kalmanhdl.cli import app

        app(prog_name="kalmanhdl")
    except (Interrupted, KeyboardInterrupt):
        sys.stderr.write("interrupted\n")
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
