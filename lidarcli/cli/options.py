"""Options that commands share, their types, and help in groups."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from inspect import signature
from typing import TYPE_CHECKING, Any, cast

import click

from lidarcli.choices import BINS, ECHOES, GREATEST_COUNT, GREATEST_NUMBER, UNITS
from lidarcli.cli.grouped import OUTPUT, F, option

if TYPE_CHECKING:
    from lidarcli.logs.base import OpenOptions
    from lidarcli.logs.batches import ReadOptions
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules
    from lidarcli.times import Instant

STDOUT = "-"
"""As the name of an output."""


class Number(click.ParamType):  # type: ignore[type-arg]
    """A finite number, not below `least`, and not farther from 0 than `most`."""

    name = "number"

    def __init__(
        self,
        metavar: str,
        least: float | None = None,
        above: float | None = None,
        most: float = GREATEST_NUMBER,
    ) -> None:
        self.metavar = metavar
        self.least = least
        self.above = above
        self.most = most

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """The unit, as help shows it."""
        return self.metavar

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number, or a usage error that says what is wrong with it."""
        try:
            number = float(value)
        except ValueError:
            self.fail(f"'{value}' is not a number.", param, ctx)
        if not math.isfinite(number):
            self.fail(f"'{value}' is not a finite number.", param, ctx)
        if self.least is not None and number < self.least:
            self.fail(f"{value} is below {self.least:g}.", param, ctx)
        if self.above is not None and number <= self.above:
            self.fail(f"{value} is not above {self.above:g}.", param, ctx)
        if abs(number) > self.most:
            below = number < 0
            self.fail(
                f"{value} is {'below' if below else 'above'} {-self.most if below else self.most:g}.",
                param,
                ctx,
            )
        return number


class Threshold(Number):
    """`adaptive`, `mean` or metres."""

    name = "threshold"
    WORDS = ("adaptive", "mean")

    def __init__(self) -> None:
        super().__init__("adaptive|mean|METRES", above=0)

    def convert(  # type: ignore[override]
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | float:
        """The word or the number."""
        if value in self.WORDS:
            return str(value)
        try:
            float(value)
        except ValueError:
            self.fail(f"'{value}' is neither adaptive nor mean nor a number of metres.", param, ctx)
        return super().convert(value, param, ctx)


class NoReturn(click.ParamType):  # type: ignore[type-arg]
    """A list of words and magic ranges that stand for "no return"."""

    name = "list"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Words and markers as `range_rules.RangeRules` wants them."""
        if ctx is not None and ctx.resilient_parsing:
            # A shell that completes a line has no time for this import.
            return value
        from lidarcli.errors import OptionError
        from lidarcli.range_rules import parse_no_return

        if not isinstance(value, str):
            return value
        try:
            words, markers = parse_no_return(value)
        except OptionError as err:
            self.fail(str(err).removeprefix("--no-return: ") + ".", param, ctx)
        return words, markers


class Line(click.ParamType):  # type: ignore[type-arg]
    """A text that may hold blanks: in the environment, several of them stand on lines of their own."""

    name = "text"
    envvar_list_splitter = "\n"


class Time(click.ParamType):  # type: ignore[type-arg]
    """Seconds after the first sweep, or date and time."""

    name = "time"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """What help shows."""
        return "TIME"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Seconds or an `Instant`, or a usage error."""
        from lidarcli.errors import OptionError
        from lidarcli.times import parse_time

        if not isinstance(value, str):
            return value
        try:
            found = parse_time(value)
        except OptionError as err:
            self.fail(f"{err}.", param, ctx)
        if isinstance(found, float) and found < 0:
            self.fail(f"{value} is below 0.", param, ctx)
        return found


METRES = Number("METRES", least=0)
TIME = Time()

# Whether they can be read is found out where they are opened, which says more than a usage error.
INPUTS = click.Path(allow_dash=True, readable=False)

RANGES = "Beams without a range"
GEOMETRY = "Text logs without geometry"
CLOUDS = "Point clouds"
ECHO = "Beams with several echoes"
SELECT = "Sweeps to read"
POSES = "Where the sensor was"


@contextmanager
def usage_errors() -> Iterator[None]:
    """Let click tell of an `OptionError`, whose words may begin with the option: `--fov: ...`."""
    from lidarcli.errors import OptionError

    try:
        yield
    except OptionError as err:
        name, mark, words = str(err).partition(": ")
        if mark and name.startswith("--") and " " not in name:
            raise click.BadParameter(f"{words}.", param_hint=f"'{name}'") from err
        raise click.UsageError(str(err)) from err


@dataclass(frozen=True, slots=True)
class Selection:
    """Which sweeps of a log to read."""

    topics: tuple[str, ...]
    start: float | Instant | None
    end: float | Instant | None
    every: int

    def read(self, rules: RangeRules) -> ReadOptions:
        """What to read, with how ranges are judged."""
        from lidarcli.logs.batches import ReadOptions

        with usage_errors():
            return ReadOptions(frozenset(self.topics) or None, self.start, self.end, self.every, rules=rules)


def text_or_json(words: str = "Text for people, or JSON for programs.") -> Callable[[F], F]:
    """`--format` of commands that tell of something: the command gets `kind`."""
    return option(
        "--format",
        "kind",
        heading=OUTPUT,
        type=click.Choice(["text", "json"]),
        default="text",
        show_default=True,
        help=words,
    )


def gathered(command: F, name: str, gather: Callable[..., Any]) -> F:
    """A command that gets the values of several options as one, `name`: what `gather` makes of them."""
    names = [*signature(gather).parameters]

    @wraps(command)
    def gathering(*arguments: Any, **values: Any) -> Any:
        values[name] = gather(**{option: values.pop(option) for option in names})
        return command(*arguments, **values)

    return cast(F, gathering)


_POSE = option(
    "--pose",
    unless=("trajectory",),
    heading=POSES,
    metavar="TOPIC",
    help="Topic with the poses of the sensor (docs/poses.md); none: no poses; match: find the path from the "
    "sweeps themselves.  [default: the best there is]",
)
_POSES = option(
    "--poses",
    "trajectory",
    unless=("pose",),
    heading=POSES,
    metavar="FILE.tum",
    type=click.Path(),
    help="Path of the sensor from a file with lines of timestamp x y z qx qy qz qw, as `lidarcli poses` and evo "
    "write it.  [default: the poses in the log]",
)
_POSE_DELAY = option(
    "--pose-delay",
    heading=POSES,
    type=Number("SECONDS"),
    default=None,
    help="Use the pose from this long after the header stamp of a sweep; negative: before it. `info` tells where "
    "another value than 0 fits better.  [default: 0; for tracks and maps what fits best]",
)
_NO_DESKEW = option(
    "--no-deskew",
    heading=POSES,
    is_flag=True,
    help="Place all beams of a sweep as seen from one place. By default each beam is placed from where the sensor "
    "was at its own time, if poses and time_increment are known.",
)


def pose_options(*, delay: bool) -> Callable[[F], F]:
    """Where the poses of a log come from: the command gets `poses`; with a `delay`, also how late they are."""

    def decorate(command: F) -> F:
        command = gathered(command, "poses", _pose_options if delay else _pose_sources)
        for add in (_NO_DESKEW, *([_POSE_DELAY] if delay else []), _POSES, _POSE):
            command = add(command)
        return command

    return decorate


def _pose_options(
    pose: str | None, trajectory: str | None, pose_delay: float | None, no_deskew: bool
) -> PoseOptions:
    """`PoseOptions` from the options."""
    from lidarcli.pipeline.reading.pose_sources import PoseOptions

    return PoseOptions(pose, trajectory, pose_delay, not no_deskew)


def _pose_sources(pose: str | None, trajectory: str | None, no_deskew: bool) -> PoseOptions:
    """The same without a delay."""
    return _pose_options(pose, trajectory, None, no_deskew)


def reading_options(command: F) -> F:
    """Which sweeps of a log to read, and where their poses come from: the command gets a `selection` and `poses`."""
    command = pose_options(delay=True)(gathered(command, "selection", Selection))
    for decorate in (
        option(
            "--every",
            heading=SELECT,
            type=click.IntRange(min=1, max=GREATEST_COUNT),
            default=1,
            show_default=True,
            metavar="N",
            help="Take every N-th sweep.",
        ),
        option(
            "--end",
            heading=SELECT,
            type=TIME,
            help="End before this time, given like --start.  [default: the end]",
        ),
        option(
            "--start",
            heading=SELECT,
            type=TIME,
            help="Start at this time: seconds after the first sweep (10, 2min), or date and time "
            "(2026-11-22T10:00:00Z).  [default: 0]",
        ),
        option(
            "--topic",
            "topics",
            heading=SELECT,
            metavar="NAME",
            multiple=True,
            help="LaserScan topic to read, or a pattern such as '/scan*'; may be repeated.  [default: all]",
        ),
    ):
        command = decorate(command)
    return command


def range_options(command: F) -> F:
    """`--range` and `--no-return`: the command gets `rules`."""
    command = gathered(command, "rules", _range_rules)
    for decorate in (
        option(
            "--no-return",
            heading=RANGES,
            type=NoReturn(),
            metavar="LIST",
            default="inf,zero,max,above,pile",
            show_default=True,
            help="Values that mean 'no return', comma separated: inf, zero, max, above, pile (a far "
            "range that very many beams have), nan, negative, below, or metres such as 81.91.",
        ),
        option(
            "--range",
            "limits",
            heading=RANGES,
            type=Number("MIN MAX", least=0),
            nargs=2,
            default=None,
            metavar="MIN MAX",
            help="Range limits in metres.  [default: those of the log]",
        ),
    ):
        command = decorate(command)
    return command


def opening_options(command: F) -> F:
    """What a log may need to be told: the command gets `opening`."""
    command = gathered(command, "opening", _open_options)
    angle = Number("ANGLE")
    for decorate in (
        option(
            "--bins",
            heading=CLOUDS,
            type=click.INT,
            metavar="N",
            help="Beams of such a sweep; their view is a full turn, or that of --angle-min and --fov.  "
            f"[default: {BINS}]",
        ),
        option(
            "--slice",
            "heights",
            heading=CLOUDS,
            type=Number("ZMIN ZMAX"),
            nargs=2,
            default=None,
            metavar="ZMIN ZMAX",
            help="Read point clouds as sweeps: of the points between these heights [m] the nearest in each direction. "
            "Heights count from the robot's base, level by tf.  [default: clouds are not read]",
        ),
        option(
            "--echo",
            heading=ECHO,
            type=click.Choice(ECHOES),
            default=ECHOES[0],
            show_default=True,
            help="Echo to take of each beam of a MultiEchoLaserScan; strongest: that of the greatest intensity.",
        ),
        option(
            "--range-unit",
            heading=GEOMETRY,
            type=click.Choice([*UNITS]),
            default="m",
            show_default=True,
            help="Unit of the ranges in the log.",
        ),
        option(
            "--degrees",
            heading=GEOMETRY,
            is_flag=True,
            help="Angles above are in degrees.  [default: radians]",
        ),
        option(
            "--range-max",
            heading=GEOMETRY,
            type=Number("METRES", above=0),
            help="Greatest range of the sensor.  [default: from the file, or none]",
        ),
        option(
            "--fov",
            unless=("angle_increment",),
            heading=GEOMETRY,
            type=angle,
            help="Field of view, instead of --angle-increment.",
        ),
        option(
            "--angle-increment",
            unless=("fov",),
            heading=GEOMETRY,
            type=angle,
            help="Angle from beam to beam.",
        ),
        option(
            "--angle-min",
            heading=GEOMETRY,
            type=angle,
            help="Bearing of the first beam.  [default: from the file, or centred on --fov]",
        ),
    ):
        command = decorate(command)
    return command


def _range_rules(
    no_return: tuple[frozenset[str], tuple[float, ...]], limits: tuple[float, float] | None
) -> RangeRules:
    """`RangeRules` from the options."""
    from lidarcli.logs.options import range_rules

    with usage_errors():
        return range_rules(limits, no_return)


def _open_options(
    angle_min: float | None,
    angle_increment: float | None,
    fov: float | None,
    range_max: float | None,
    degrees: bool,
    range_unit: str,
    heights: tuple[float, float] | None,
    bins: int | None,
    echo: str,
) -> OpenOptions:
    """`OpenOptions` from the options; the range limits also say which points of a cloud are the robot itself."""
    from lidarcli.logs.options import open_options

    with usage_errors():
        return open_options(
            angle_min=angle_min,
            angle_increment=angle_increment,
            fov=fov,
            range_max=range_max,
            degrees=degrees,
            range_unit=range_unit,
            heights=heights,
            bins=bins,
            limits=click.get_current_context().params.get("limits"),
            echo=echo,
        )
