"""`lidarcli background`: learn a scene, and find what differs from it; its words for `lidarcli info`, too."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import click

from lidarcli.cli.commands import Commands, command, log_options
from lidarcli.cli.detect import DetectCommand, find
from lidarcli.cli.messages import MessageWriter, chosen_logs, frame_words, line_of, print_reads, progress_bar, show_reading
from lidarcli.display.texts import counted
from lidarcli.files.stores import place
from lidarcli.options.choices import IMAGES
from lidarcli.options.common import ManyLogs, Overwrite, TextOrJson, output
from lidarcli.options.forms import File, Option
from lidarcli.options.groups import LearningGroup
from lidarcli.options.values import OUTPUT, STDOUT

if TYPE_CHECKING:
    from lidarcli.formalism.background import Background
    from lidarcli.pipeline.building import Learned


class BuildCommand(ManyLogs, Overwrite, TextOrJson, LearningGroup, total=False):
    output: Annotated[str, output("FILE"), "Background table to write (Parquet)."]
    plot: Annotated[
        str | None, Option(OUTPUT, File("FIG", is_output=True), shown="none"), "Also draw it: .png, .svg or .pdf."
    ]


@command(
    BuildCommand,
    examples="""\
  lidarcli background build empty.mcap -o empty.background.parquet
  lidarcli background build mon.bag tue.bag -o hall.parquet --plot hall.png
  lidarcli background build lap.mcap -o route.parquet --pose /odom \\
    --station-distance 0.5 --station-angle 10""",
)
def build(messages: MessageWriter, options: BuildCommand) -> int:
    """Learn an empty scene from logs.

    For every beam it learns r_e, the farthest surface that enough sweeps agree on: people
    may walk through the scene in up to 30 % of the sweeps.
    Several logs make one background. Where a log has poses, every viewpoint gets a
    background of its own. `lidarcli background subtract` finds what differs from it;
    info shows what it knows.
    """
    figure, overwrite = options["plot"], options["overwrite"]
    if figure and place(figure).suffix.lower() not in IMAGES:
        raise click.BadParameter(f"'{figure}' is none of {', '.join(IMAGES)}.", param_hint="'--plot'")
    if options["output"] == STDOUT:
        raise click.UsageError("a background is no text for standard output; give the name of a file")
    logs = log_options(options)

    from lidarcli.pipeline.building import (
        BackgroundBuilder,
        BuildOptions,
        draw_background,
        refuse_nothing,
        refuse_output,
        scene_notes,
    )
    from lidarcli.pipeline.runs.over_logs import exit_code

    path = place(options["output"])
    messages.begin(options)
    sources = chosen_logs(messages, options)
    refuse_output([path, *([place(figure)] if figure else [])], sources, overwrite)
    if options["dry_run"]:
        return print_reads(sources, [options["output"], figure] if figure else [options["output"]])
    building = BackgroundBuilder(
        BuildOptions(*logs, distance=options["station_distance"], angle=math.radians(options["station_angle"]))
    )
    codes = []
    with progress_bar(sources, messages) as report:
        for outcome in building.add_all(sources, report):
            show_reading(outcome, messages)
            codes.append(outcome.exit_code)
    sensors = building.sensors()
    if any(codes) and not sensors:
        return messages.end(exit_code(codes), sensors=[])
    refuse_nothing(sensors)
    for note in [*building.notes(), *scene_notes(sensors)]:
        messages.note(note)
    for line in learned_lines(sensors):
        messages.info(line)
    notes = building.write(path, sensors, overwrite)
    messages.wrote([path])
    if figure:
        notes += draw_background(place(figure), sensors, overwrite)
        messages.wrote([figure])
    messages.notes(notes)
    return messages.end(exit_code(codes), sensors=[_sensor_json(sensor) for sensor in sensors])


@command(
    DetectCommand,
    changed={"background": {"required": True, "shown": None}},
    examples="""\
  lidarcli background subtract run.mcap --background empty.background.parquet
  lidarcli background subtract bags/ --background hall.parquet -o tables
  lidarcli background subtract run.mcap --background hall.parquet --removed
  lidarcli background subtract run.bag --background hall.parquet --any-frame""",
)
def subtract(messages: MessageWriter, options: DetectCommand) -> int:
    """Find what differs from an empty scene, in every sweep.

    The same as `lidarcli detect --background FILE`, with the same options and tables:
    objects are built of the beams that differ, and the columns difference (r_w - r_e)
    and change say how.
    """
    return find(messages, options, follow=False)


def background() -> Commands:
    """Learn an empty scene, and find what differs from it.

    build learns the range of the background in every direction; subtract
    compares logs with it (docs/background.md).
    """
    made = Commands("background", commands=[build(), subtract()], help=background.__doc__)
    made.superseded = {"info": "lidarcli info FILE"}
    made.otherwise = "To learn from logs: lidarcli background build LOG... -o FILE"
    return made


def learned_lines(sensors: Sequence["Background"]) -> list[str]:
    """Two lines per sensor, after it was learned."""
    from lidarcli.pipeline.building import figures_of

    lines = []
    for sensor in sensors:
        figures = figures_of(sensor)
        lines += [
            f"  {sensor.topic} ({frame_words(sensor.frame_id)}): {counted(len(sensor), 'station')} of "
            f"{sensor.grid.beams} beams, {counted(figures['sweeps'], 'sweep')}",
            f"  beams    {_shares(figures)}",
        ]
        if figures["spread"] is not None:
            lines[-1] += f"; spread {figures['spread']:.3f} m, support {figures['support']:.1%}"
    return lines


def background_lines(learned: "Learned") -> list[str]:
    """Lines on a background table for people."""
    from lidarcli.pipeline.building import figures_of, scene_notes

    sensors, metadata = learned.sensors, learned.metadata
    lines = [learned.path, _line("version", metadata.get("lidarcli.version", ""))]
    for origin in _origins(metadata):
        lines.append(_line("from", f"{origin.get('name', '')} ({origin.get('format', 'unknown format')})"))
    for damage in metadata.get("lidarcli.damage", []):
        lines.append(_line("damage", damage))
    lines += [_line("note", note) for note in scene_notes(sensors)]
    for sensor in sensors:
        figures = figures_of(sensor)
        view = sensor.grid.bearings
        low, high = math.degrees(view.min(initial=0.0)), math.degrees(view.max(initial=0.0))
        at_a_station = f", {sensor.sweeps.min():,} to {sensor.sweeps.max():,} at a station"
        lines += [
            f"  {sensor.topic} ({frame_words(sensor.frame_id)})",
            _line("beams", f"{sensor.grid.beams} from {low:.2f} to {high:.2f} deg", 4),
            _line("stations", _stations(sensor), 4),
            _line("sweeps", f"{figures['sweeps']:,}{at_a_station if len(sensor) > 1 else ''}", 4),
            _line("background", _shares(figures), 4),
        ]
        if figures["r_e_min"] is not None:
            lines += [
                _line("r_e", f"{figures['r_e_min']:.2f} to {figures['r_e_max']:.2f} m", 4),
                _line("spread", f"{figures['spread']:.3f} m (median)", 4),
                _line("support", f"{figures['support']:.1%} (median), least {figures['least_support']:.1%}", 4),
            ]
    return lines


def background_line(learned: "Learned") -> str:
    """One line: the table, and each sensor with its stations, beams and sweeps."""
    sensors = ", ".join(
        f"{each.topic} {counted(len(each), 'station')} of {each.grid.beams} beams, "
        f"{counted(int(each.sweeps.sum()), 'sweep')}"
        for each in learned.sensors
    )
    return f"{learned.path}: background, {sensors}"


def background_dict(learned: "Learned") -> dict[str, Any]:
    """Plain values of a background table; angles in radians, ranges in metres."""
    metadata = learned.metadata
    return {
        "path": learned.path,
        "format": "background",
        "version": metadata.get("lidarcli.version"),
        "source": _origins(metadata),
        "parameters": metadata.get("lidarcli.parameters"),
        "damage": metadata.get("lidarcli.damage", []),
        "sensors": [_sensor_json(sensor) for sensor in learned.sensors],
    }


def _sensor_json(sensor: "Background") -> dict[str, Any]:
    from lidarcli.pipeline.building import figures_of

    grid = sensor.grid
    return {
        "topic": sensor.topic,
        "frame_id": sensor.frame_id,
        "angle_min": grid.angle_min,
        "angle_increment": grid.angle_increment,
        "beams": grid.beams,
        "range_max": sensor.range_max if math.isfinite(sensor.range_max) else None,
        "seems_moved": sensor.seems_moved,
        "stations": len(sensor),
        "posed": bool(sensor.posed.any()),
        "station_distance": sensor.distance,
        "station_angle": sensor.angle,
        **figures_of(sensor),
    }


def _shares(figures: Mapping[str, Any]) -> str:
    total = max(figures["surface"] + figures["open"] + figures["unknown"], 1)
    return ", ".join(f"{name} {figures[name]:,} ({figures[name] / total:.1%})" for name in ("surface", "open", "unknown"))


def _stations(sensor: "Background") -> str:
    if not sensor.posed.any():
        return f"{len(sensor)}, pose unknown"
    x, y = sensor.poses.x, sensor.poses.y
    reach = f"within {sensor.distance:g} m and {math.degrees(sensor.angle):g} deg"
    return f"{len(sensor):,}, x {x.min():.2f} to {x.max():.2f} m, y {y.min():.2f} to {y.max():.2f} m, sweeps {reach}"


def _origins(metadata: Mapping[str, Any]) -> list[dict[str, Any]]:
    origin = metadata.get("lidarcli.source") or []
    return origin if isinstance(origin, list) else [origin]


def _line(name: str, value: str, indent: int = 2) -> str:
    return line_of(name, value, indent, 16)
