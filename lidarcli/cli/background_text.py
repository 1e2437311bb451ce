"""What a background knows, in words and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lidarcli.formalism.background.model import Background


def learned_lines(sensors: Sequence[Background]) -> list[str]:
    """Two lines per sensor, after it was learned."""
    from lidarcli.pipeline.building import figures_of

    lines = []
    for sensor in sensors:
        figures = figures_of(sensor)
        lines += [
            f"  {sensor.topic} ({_frame(sensor)}): {_count(len(sensor), 'station')} of {sensor.grid.beams} beams, "
            f"{_count(figures['sweeps'], 'sweep')}",
            f"  beams    {_shares(figures)}{_quality(figures)}",
        ]
    return lines


def as_text(file: str, sensors: Sequence[Background], metadata: Mapping[str, Any]) -> str:
    """Everything for people."""
    from lidarcli.pipeline.building import figures_of, scene_notes

    lines = [file, _line("version", metadata.get("lidarcli.version", ""))]
    for origin in _origins(metadata):
        lines.append(_line("from", f"{origin.get('name', '')} ({origin.get('format', 'unknown format')})"))
    for damage in metadata.get("lidarcli.damage", []):
        lines.append(_line("damage", damage))
    lines += [_line("note", note) for note in scene_notes(sensors)]
    for sensor in sensors:
        figures = figures_of(sensor)
        view = sensor.grid.bearings()
        low, high = math.degrees(view.min(initial=0.0)), math.degrees(view.max(initial=0.0))
        lines += [
            f"  {sensor.topic} ({_frame(sensor)})",
            _line("beams", f"{sensor.grid.beams} from {low:.2f} to {high:.2f} deg", 4),
            _line("stations", _stations(sensor), 4),
            _line("sweeps", f"{figures['sweeps']:,}" + _each(sensor), 4),
            _line("background", _shares(figures), 4),
        ]
        if figures["r_e_min"] is not None:
            lines += [
                _line("r_e", f"{figures['r_e_min']:.2f} to {figures['r_e_max']:.2f} m", 4),
                _line("spread", f"{figures['spread']:.3f} m (median)", 4),
                _line(
                    "support", f"{figures['support']:.1%} (median), least {figures['least_support']:.1%}", 4
                ),
            ]
    return "\n".join(lines)


def as_json(file: str, sensors: Sequence[Background], metadata: Mapping[str, Any]) -> str:
    """One object; angles in radians, ranges in metres."""
    found = {
        "path": file,
        "version": metadata.get("lidarcli.version"),
        "source": _origins(metadata),
        "parameters": metadata.get("lidarcli.parameters"),
        "damage": metadata.get("lidarcli.damage", []),
        "sensors": [_sensor_json(sensor) for sensor in sensors],
    }
    return json.dumps(found, indent=2, ensure_ascii=False)


def _sensor_json(sensor: Background) -> dict[str, Any]:
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
    return ", ".join(
        f"{name} {figures[name]:,} ({figures[name] / total:.1%})" for name in ("surface", "open", "unknown")
    )


def _quality(figures: Mapping[str, Any]) -> str:
    return (
        ""
        if figures["spread"] is None
        else f"; spread {figures['spread']:.3f} m, support {figures['support']:.1%}"
    )


def _stations(sensor: Background) -> str:
    if not sensor.posed.any():
        return f"{len(sensor)}, pose unknown"
    x, y = sensor.poses.x, sensor.poses.y
    reach = f"within {sensor.distance:g} m and {math.degrees(sensor.angle):g} deg"
    return f"{len(sensor):,}, x {x.min():.2f} to {x.max():.2f} m, y {y.min():.2f} to {y.max():.2f} m, sweeps {reach}"


def _each(sensor: Background) -> str:
    if len(sensor) < 2:
        return ""
    return f", {sensor.sweeps.min():,} to {sensor.sweeps.max():,} at a station"


def _origins(metadata: Mapping[str, Any]) -> list[dict[str, Any]]:
    origin = metadata.get("lidarcli.source") or []
    return origin if isinstance(origin, list) else [origin]


def _frame(sensor: Background) -> str:
    return f"frame {sensor.frame_id}" if sensor.frame_id else "no frame"


def _line(name: str, value: str, indent: int = 2) -> str:
    return f"{' ' * indent}{name:<{16 - indent}}{value}"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}" + ("" if number == 1 else "s")
