"""The options that say what an object is: the same for every command that looks for some."""

from __future__ import annotations

from collections.abc import Callable

import click

from lidarcli.choices import GREATEST_COUNT, MIN_THING
from lidarcli.cli.grouped import F, option
from lidarcli.cli.options import METRES, Number, Threshold

OBJECTS = "Objects"
THINGS = "Things of interest"


def catalogue_option(command: F) -> F:
    """`--catalogue`: the command gets the path of a `catalogue`."""
    return option(
        "--catalogue",
        heading=THINGS,
        metavar="FILE",
        type=click.Path(),
        help="Things with their sizes (TOML, docs/catalogue.md): objects that are one of them get its name.  "
        "[default: none]",
    )(command)


def object_options(*, walls: str, no_limit: str) -> Callable[[F], F]:
    """`--profile` to `--walls`; `walls` is the help of the last, `no_limit` names where there is no greatest width."""

    def decorate(command: F) -> F:
        for add in reversed(
            (
                option(
                    "--profile",
                    heading=OBJECTS,
                    type=click.Choice(["robust", "paper"]),
                    default="robust",
                    show_default=True,
                    help="robust: tuned for real sensors; paper: the published formulas, unchanged.",
                ),
                option(
                    "--threshold",
                    heading=OBJECTS,
                    type=Threshold(),
                    help="Jump in range that separates two surfaces: adaptive (by noise and range), mean (of |s|, the "
                    "paper's Def. 3), or metres.  "
                    "[default: adaptive; paper: mean]",
                ),
                option(
                    "--min-beams",
                    heading=OBJECTS,
                    type=click.IntRange(min=1, max=GREATEST_COUNT),
                    metavar="N",
                    help="Smallest number of valid beams that an object may have.  [default: 3; paper: 1]",
                ),
                option(
                    "--max-width",
                    heading=OBJECTS,
                    type=Number("METRES", above=0),
                    help=f"Largest object; anything wider counts as wall.  [default: 2; {no_limit}: no limit]",
                ),
                option(
                    "--max-gap",
                    heading=OBJECTS,
                    type=click.IntRange(min=0, max=GREATEST_COUNT),
                    metavar="N",
                    help="How many missing beams in a row may be bridged within one surface.  [default: 2; paper: 0]",
                ),
                option(
                    "--group-gap",
                    heading=OBJECTS,
                    type=METRES,
                    help="Join narrow objects (up to 0.2 m) that are closer than this: the legs of a person or chair.  "
                    "[default: 0, never]",
                ),
                option(
                    "--min-thing",
                    heading=OBJECTS,
                    type=Number("P", least=0.0, most=1.0),
                    help="Least probability, 0 to 1, that an object is a thing and not a piece of building; what has less "
                    "counts as wall.  "
                    f"[default: {MIN_THING}]",
                ),
                option("--walls", heading=OBJECTS, is_flag=True, help=walls),
            )
        ):
            command = add(command)
        return command

    return decorate
