"""`lidarcli --version`: what a report of a bug needs to tell."""

from __future__ import annotations

import click

from lidarcli import compiled
from lidarcli._version import __version__

LIBRARIES = ("numpy", "pyarrow", "mcap", "rosbags", "pandas", "matplotlib", "click", "rich")
EXTRAS = ("distributed", "kiss-icp")


def print_version(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    """The callback of the option: print and leave."""
    if value and not ctx.resilient_parsing:
        click.echo(version_text())
        ctx.exit()


def version_text() -> str:
    """The version of lidarcli on a line of its own, then whether it is compiled, the system and the libraries."""
    import platform
    import textwrap

    def line(name: str, words: str) -> str:
        head = f"  {name:<11}"
        return textwrap.fill(words, 79, initial_indent=head, subsequent_indent=" " * len(head))

    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return "\n".join(
        (
            f"lidarcli {__version__}",
            line("core", compiled.about_core()),
            line("system", system),
            line("libraries", ", ".join(_found(LIBRARIES))),
            line("optional", ", ".join(_found(EXTRAS)) or "none"),
        )
    )


def _found(names: tuple[str, ...]) -> list[str]:
    """Those that are installed, with their versions."""
    from importlib.metadata import PackageNotFoundError, version

    found = []
    for name in names:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return found
