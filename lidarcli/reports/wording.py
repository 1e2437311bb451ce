"""Numbers, stamps and lists as people read them; shared by all formats for people."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from lidarcli.choices import beams_on
from lidarcli.display import date_and_time
from lidarcli.reports.columns import Origin
from lidarcli.reports.figures import CATEGORIES, DELTA, TRACK_CATEGORIES, TRACK_SPREADS, Spread, unit_of
from lidarcli.reports.streams import Unlike
from lidarcli.reports.summary import Summary
from lidarcli.reports.tracks import Track, Tracked

NONE = "-"
TINY = 1e-12
NAMED = 3
"""Most frames that are named."""
SHOWN_SPREADS = (
    "objects_per_sweep",
    "nearest",
    "range",
    "width",
    "box_length",
    "box_width",
    "beams_per_object",
    "intensity",
    "difference",
    "d_th",
    "noise",
    "lost_share",
    "step",
)
SHOWN_STATISTICS = ("mean", "min", "p05", "p50", "p95", "max")

COMPARED = (
    "sweeps",
    "valid_share",
    "no_return_share",
    "gaps",
    "longest_gap",
    "rate",
    "objects_per_sweep.mean",
    "objects_per_sweep.p95",
    "agents_per_sweep.mean",
    "nearest.min",
    "range.min",
    "range.p50",
    "width.p50",
    "width.p95",
    "d_th.mean",
    "noise.p50",
    "tracks",
    "tracks.agents",
    "agents_at_once.mean",
    "agents_at_once.max",
    "tracks.duration.p50",
    "tracks.distance.p50",
)
"""Figures that a comparison shows, where they are there, with the kinds of objects."""


def visible(text: str) -> str:
    r"""Text of a log with escapes for what would steer the terminal that it is shown on.

    >>> visible("/scan\x1b[2J °")
    '/scan\\x1b[2J °'
    """
    return "".join(mark if mark.isprintable() else repr(mark)[1:-1] for mark in text)


def number(value: float | None, digits: int = 4, sign: bool = False) -> str:
    """A number of few digits, with thousands set apart.

    >>> [number(value) for value in (None, 12345, 0.123456, 3.0, 123456.7)]
    ['-', '12,345', '0.1235', '3', '123,457']
    """
    if value is None or not math.isfinite(value):
        return NONE
    # What a computation leaves of nothing is nothing.
    value = 0.0 if abs(value) < TINY else value
    mark = "+" if sign and value else ""
    if value == int(value) or abs(value) >= 10**digits:
        return f"{value:{mark},.0f}"
    return f"{value:{mark}.{digits}g}"


def quantity(name: str, value: float | None, sign: bool = False) -> str:
    """A figure with its unit; a share in per cent."""
    if value is None:
        return NONE
    plain = name.removeprefix(DELTA)
    if plain.endswith("_share") or plain.startswith("lost_share."):
        return f"{100 * value:{'+' if sign and value else ''}.2f} %"
    unit = unit_of(name)
    return number(value, sign=sign) + ("" if unit == "1" else f" {unit}")


def share(count: float, total: float) -> str:
    """A part of a whole in per cent."""
    return percent(count / total) if total else NONE


def percent(part: float) -> str:
    """A part of one in per cent.

    >>> percent(0.0625)
    '6.2 %'
    """
    return f"{100 * part:.1f} %"


def counted(value: float | None, name: str) -> str:
    """A number of things.

    >>> counted(1, "log"), counted(1200, "log")
    ('1 log', '1,200 logs')
    """
    return f"{number(value)} {name}{'' if value == 1 else 's'}"


def span(values: Sequence[float]) -> str:
    """The least and the greatest value, one number where people would read the same twice.

    >>> span([20.0, 5.0, 10.0]), span([10.0, 10.0000001])
    ('5 to 20', '10')
    """
    return " to ".join(dict.fromkeys(number(value) for value in (min(values), max(values))))


def rate(summary: Summary) -> str:
    """How many sweeps there are in a second; from the least to the greatest where sensors are unlike."""
    if summary.unlike.rates:
        return f"{span(summary.unlike.rates)} Hz"
    return quantity("rate", summary.figures["rate"])


def clock(summary: Summary) -> str:
    """The rate, and what is wrong with the stamps of the sweeps."""
    figures = summary.figures
    faults = []
    if figures["gaps"]:
        longest = quantity("longest_gap", figures["longest_gap"])
        missing = counted(figures["missing_sweeps"], "sweep")
        faults.append(f"{counted(figures['gaps'], 'gap')} ({missing} missing, the longest gap {longest})")
    if figures["backward"]:
        faults.append(f"{counted(figures['backward'], 'stamp')} before the previous one")
    if figures["repeated"]:
        faults.append(f"{counted(figures['repeated'], 'stamp')} repeated")
    if figures["rate"] is None:
        return ", ".join(faults) or "too few sweeps to tell"
    return ", ".join([rate(summary), *(faults or ["no gaps", "all stamps increasing"])])


def differences(unlike: Unlike) -> str:
    """In what sensors are unlike; empty where they are not."""
    parts = [f"{span(unlike.rates)} Hz"] if unlike.rates else []
    parts += [f"{span(unlike.beams)} beams"] if unlike.beams else []
    if unlike.frames:
        more = f" and {len(unlike.frames) - NAMED:,} more" if len(unlike.frames) > NAMED else ""
        named = ", ".join(name or "(no name)" for name in unlike.frames[:NAMED])
        parts.append(f"frames {named}{more}")
    return "; ".join(parts)


def stamp(stamp_ns: int) -> str:
    """A stamp in UTC, to the millisecond.

    >>> stamp(1_700_000_000_123_456_789)
    '2023-11-14T22:13:20.123Z'
    """
    try:
        return date_and_time(stamp_ns)
    except (OverflowError, ValueError, OSError):
        return f"{stamp_ns} ns"


def settings(source: Origin) -> str:
    """The parameters of a run that are worth a line: the profile, and what is not null."""
    found = {name: value for name, value in source.parameters.items() if value not in (None, False, [], 0.0)}
    return ", ".join(f"{name} {_plain(value)}" for name, value in found.items()) or "not recorded"


def origin(source: Origin) -> str:
    """Format and size of a log."""
    size = f", {source.size:,} bytes" if source.size is not None else ""
    return f"{source.format or 'unknown format'}{size}"


def origins(sources: Sequence[Origin]) -> str:
    """Formats of several logs, and the size of all of them."""
    formats = Counter(source.format or "unknown format" for source in sources)
    size = sum(source.size or 0 for source in sources)
    return f"{', '.join(f'{count:,} {name}' for name, count in formats.items())}; {size:,} bytes"


def has_agents(summary: Summary) -> bool:
    """Whether there is anything to say of agents: something was tracked, or they came with the tables."""
    return summary.tracked is not None or bool(summary.figures["agents"])


def agents(summary: Summary) -> str:
    """How many of the objects are agents, and of how many things where these were followed."""
    words = f"{number(summary.figures['agents'])} of these objects"
    return (
        words
        if summary.tracked is None
        else f"{words}, of {counted(summary.figures['tracks.agents'], 'thing')}"
    )


def beams_by_set(summary: Summary) -> dict[str, int]:
    """What the beams fell on; without agents where nobody looked for them."""
    return {
        words if name == "S" else f"on {words}": summary.sets[name]
        for name, words in beams_on(has_agents(summary)).items()
    }


def kind_counts(summary: Summary, name: str) -> dict[str, int]:
    """Objects by kind, in the order of the declaration."""
    counts = summary.kinds[name]
    return {kind: counts[kind] for kind in CATEGORIES[name] if kind in counts}


def tracked_words(tracked: Tracked) -> dict[str, str]:
    """What matters most of the tracks: how many, how many agents at once, what kind of scene."""
    count, agents = tracked.figures["tracks"], tracked.figures["tracks.agents"]
    at_once = tracked.spreads["agents_at_once"]
    words = {
        "things": f"{number(count)}, {number(agents)} of them {'an agent' if agents == 1 else 'agents'}",
        "agents at once": f"{number(at_once.mean, 3)} on average, at most {number(at_once.max)}",
    }
    if tracked.scene is not None:
        part = number(100 * (tracked.agent_share or 0.0), 2)
        words["scene"] = f"{tracked.scene}: {part} % of the beams on agents"
    return words


def track_spreads(tracked: Tracked) -> list[tuple[str, list[str]]]:
    """The lines of the table of spreads that are about tracks."""
    return [
        (spread_name(name), spread_row(name, tracked.spreads[name]))
        for name in TRACK_SPREADS
        if tracked.spreads[name].count
    ]


def track_kinds(tracked: Tracked, name: str) -> dict[str, int]:
    """Tracks by kind, in the order of the declaration."""
    counts = tracked.kinds[name]
    return {kind.replace("_", " "): counts[kind] for kind in TRACK_CATEGORIES[name] if kind in counts}


def track_cells(one: Track) -> dict[str, str]:
    """What a table for people says of a track: heading → cell."""
    sizes = [number(value, 3) for value in (one.length, one.width) if math.isfinite(value)]
    return {
        "track": str(one.number),
        "kind": "agent" if one.is_agent else "object",
        "shape": one.shape,
        "label": one.label,
        "first seen": f"{number(one.start)} s",
        "duration": f"{number(one.duration)} s",
        "sweeps": number(one.sweeps),
        "hidden": f"{number(one.hidden)} s",
        "size": f"{' x '.join(sizes)} m" if sizes else NONE,
        "distance": f"{number(one.distance, 3)} m",
        "mean speed": f"{number(one.speed_mean, 2)} m/s",
        "top speed": f"{number(one.speed_max, 2)} m/s",
        "end": one.end,
    }


def spreads(summary: Summary) -> list[tuple[str, list[str]]]:
    """The lines of the table of spreads, without those that mean nothing of unlike sensors together."""
    unlike = summary.unlike
    left_out = {*(["step"] if unlike.rates else []), *(["beams_per_object"] if unlike.beams else [])}
    return [
        (spread_name(name), spread_row(name, summary.spreads[name]))
        for name in SHOWN_SPREADS
        if summary.spreads[name].count and name not in left_out
    ]


def spread_row(name: str, spread: Spread) -> list[str]:
    """One line of the table of spreads."""
    if name == "lost_share":
        return [quantity(name + ".", getattr(spread, part)) for part in SHOWN_STATISTICS]
    return [number(getattr(spread, part)) for part in SHOWN_STATISTICS]


def spread_name(name: str) -> str:
    """The figure with its unit."""
    unit = unit_of(name)
    return name if unit == "1" else f"{name} [{unit}]"


def compared_rows(
    here: Mapping[str, float | None],
    there: Mapping[str, float | None],
    delta: Mapping[str, float | None],
    names: Sequence[str] = COMPARED,
) -> Iterator[tuple[str, str, str, str]]:
    """Figure, value in the baseline, here, difference, of those that either of the two runs has.

    Numbers of agents, and of objects by kind, are left out where neither has any.
    """
    for name in names:
        before, now = there.get(name), here.get(name)
        is_kind = name.split(".")[0] in ("agents_per_sweep", *CATEGORIES)
        if (before or now) if is_kind else (before is not None or now is not None):
            change = quantity(name, delta.get(f"delta.{name}"), sign=True)
            yield name, quantity(name, before), quantity(name, now), change


def _plain(value: object) -> str:
    if isinstance(value, list):
        return "[" + " ".join(map(str, value)) + "]"
    if isinstance(value, dict):
        return "{" + " ".join(f"{key}={item}" for key, item in value.items()) + "}"
    return str(value)
