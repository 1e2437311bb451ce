"""The options of `lidarcli plot` that say which sweeps are drawn, how the picture looks, and where it goes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from lidarcli.choices import (
    ANIMATED_DPI,
    ANIMATIONS,
    FRAMES_PER_SECOND,
    GREATEST_COUNT,
    IMAGES,
    PICTURE_DPI,
    PICTURE_WIDTHS,
    Look,
)
from lidarcli.cli.grouped import F, option
from lidarcli.cli.options import STDOUT, Number, gathered
from lidarcli.stores.url import Place, place

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import Source

LOOK = "Look"
LAST = 1_000_000_000
"""The number of a sweep in an option is no larger: three years at 10 Hz."""
MOST_FRAMES = 50.0
"""Frames per second: viewers of GIF files show no more."""


class Sweeps(click.ParamType):  # type: ignore[type-arg]
    """Indices of sweeps: `0,50,100`, or `0:100:10` as Python counts."""

    name = "sweeps"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """Each index once, in the order given."""
        if isinstance(value, tuple):
            return value
        found: dict[int, None] = {}
        for part in value.split(","):
            try:
                numbers = [int(text) for text in part.split(":")]
            except ValueError:
                self.fail(f"'{part}' is neither a number nor START:STOP nor START:STOP:STEP.", param, ctx)
            if min(numbers) < 0 or len(numbers) > 3 or (len(numbers) == 3 and not numbers[2]):
                self.fail(f"'{part}' is no number of a sweep, nor a range of them.", param, ctx)
            more = range(*numbers) if len(numbers) > 1 else numbers
            if max(numbers) > LAST:
                self.fail(f"'{part[:40]}' goes beyond {LAST:,}.", param, ctx)
            if len(found) + len(more) > GREATEST_COUNT:
                self.fail(f"'{part}' is too many sweeps.", param, ctx)
            found |= dict.fromkeys(more)
        if not found:
            self.fail(f"'{value}' holds no sweep.", param, ctx)
        return tuple(found)


def look_options(command: F) -> F:
    """Size, title, legend, speed: the command gets `look`."""
    command = gathered(command, "look", _look)
    for decorate in (
        option(
            "--fps",
            heading=LOOK,
            type=Number("NUMBER", least=0.1, most=MOST_FRAMES),
            default=None,
            help=f"Sweeps per second of --animate.  [default: {FRAMES_PER_SECOND:g}]",
        ),
        option(
            "--vertices",
            heading=LOOK,
            is_flag=True,
            help="Mark vertices and nearest points in the scene and in polar, too.",
        ),
        option("--no-legend", heading=LOOK, is_flag=True, help="Leave the legend out."),
        option("--no-title", heading=LOOK, is_flag=True, help="Leave the title out."),
        option(
            "--dpi",
            heading=LOOK,
            type=click.IntRange(min=PICTURE_DPI[0], max=PICTURE_DPI[1]),
            metavar="N",
            help=f"Pixels per inch of PNG and of animations.  [default: 200; with --animate {ANIMATED_DPI}]",
        ),
        option(
            "--width",
            heading=LOOK,
            type=Number("MM", least=PICTURE_WIDTHS[0], most=PICTURE_WIDTHS[1]),
            default=None,
            help="Width of the picture in millimetres: 89 is a column of a paper, 183 are two.  [default: by --view]",
        ),
    ):
        command = decorate(command)
    return command


def _look(
    width: float | None, dpi: int | None, no_title: bool, no_legend: bool, vertices: bool, fps: float | None
) -> Look:
    return Look(width, dpi, not no_title, not no_legend, vertices, fps)


def refuse_look(look: Look, paths: list[Place], view: str, animate: bool, in_world: bool) -> None:
    """Refuse what this picture has no use for."""
    if look.fps is not None and not animate:
        raise click.UsageError("--fps is for --animate")
    if look.vertices and (in_world or view not in ("all", "scene", "polar")):
        raise click.UsageError("--vertices are marked in the scene; give --view all, scene or polar")
    if look.dpi is not None and str(paths[0]) != STDOUT and paths[0].suffix.lower() in (".svg", ".pdf"):
        raise click.UsageError("--dpi is for .png and animations; .svg and .pdf have no pixels")


def wanted_sweeps(sweep: int | None, sweeps: tuple[int, ...] | None, animate: bool) -> tuple[int, ...] | None:
    """The sweeps to draw; None for all."""
    if sweep is not None and sweeps is not None:
        raise click.UsageError("--sweep and --sweeps exclude each other")
    if sweep is not None:
        return (sweep,)
    return (0,) if sweeps is None and not animate else sweeps


def outputs(
    output: str | None, source: Source, wanted: tuple[int, ...] | None, animate: bool, in_world: bool
) -> list[Place]:
    """The files to write: by default named after the log, in the current directory."""
    log = source.name.rpartition("/")[2]
    one = animate or wanted is None or len(wanted) == 1
    if output is not None:
        path = place(output)
        return [path] if one else _numbered(path, wanted or ())
    if animate:
        return [place(f"{log}.gif")]
    name = place(f"{log}-map.png" if in_world else f"{log}.png")
    return [name] if wanted is None else _numbered(name, wanted)


def refuse_suffix(output: str | None, animate: bool) -> None:
    """Refuse a name that says no format, or the wrong one."""
    if output is None or output == STDOUT:
        return
    known = ANIMATIONS if animate else IMAGES
    if place(output).suffix.lower() not in known:
        still = " or --animate" if place(output).suffix.lower() in ANIMATIONS else ""
        raise click.UsageError(f"{output}: the suffix has to be one of {', '.join(known)}{still}")


def _numbered(path: Place, sweeps: tuple[int, ...]) -> list[Place]:
    """One name for each of several sweeps."""
    return [path.with_name(f"{path.stem}-{index}{path.suffix}") for index in sweeps]
