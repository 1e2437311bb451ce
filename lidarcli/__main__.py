"""The entry of the command line, also by `python -m lidarcli`."""

import sys

from lidarcli.interrupts import wait_for_imports


def main() -> None:
    """Run the command line; ctrl-C has its one line also while modules are still being imported."""
    try:
        wait_for_imports()
        from lidarcli.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("lidarcli: interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
