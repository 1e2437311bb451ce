"""The entry of the command line, also by `python -m lidarcli`."""

import sys


def main() -> None:
    """Run the command line; ctrl-C has its one line also while modules are still being imported."""
    try:
        from lidarcli.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("lidarcli: interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
