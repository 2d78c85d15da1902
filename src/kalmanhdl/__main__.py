"""The command's door, and ``python -m kalmanhdl``."""

import sys


def main() -> None:
    """Run the command; Ctrl-C ends it with one line even while it is still being imported."""
    try:
        from kalmanhdl.cli import app

        app(prog_name="kalmanhdl")
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
