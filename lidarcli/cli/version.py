"""`lidarcli --version`: what a report of a bug needs to tell."""

from __future__ import annotations

import click

from lidarcli import compiled
from lidarcli._version import __version__

LIBRARIES = ("numpy", "pyarrow", "mcap", "rosbags", "matplotlib", "click", "rich")
EXTRAS = ("pandas", "distributed", "kiss-icp")


def print_version(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    """The callback of the option: print and leave."""
    if value and not ctx.resilient_parsing:
        click.echo(version_text())
        ctx.exit()


def version_text() -> str:
    """The version of lidarcli on a line of its own, then whether it is compiled, the system and the libraries."""
    import platform

    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return "\n".join(
        (
            f"lidarcli {__version__}",
            f"  core       {compiled.about_core()}",
            f"  system     {system}",
            f"  libraries  {', '.join(_found(LIBRARIES))}",
            f"  optional   {', '.join(_found(EXTRAS)) or 'none'}",
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
