"""Findings: faults of the sweeps or poses of a log, each with its evidence, its threshold and a fix."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Collection, Mapping
from operator import attrgetter
from typing import Any, Literal, NamedTuple

from lidarcli.system.records import asdict, dataclass, field, replace

Level = Literal["error", "warning", "hint"]
"""`error`: tables of this log would be wrong; `warning`: they may be; `hint`: good to know."""
LEVELS: tuple[Level, ...] = ("error", "warning", "hint")
"""The most harmful first."""
FixKind = Literal["option", "transform", "mask", "mount"]

IDS = (
    *("geometry", "units", "limits", "no_return", "too_close", "gaps", "clock", "rolling", "duplicate"),
    *("observed", "frames", "drift", "delay", "mirror", "stamp", "mount", "lasers", "body"),
    *("flicker", "lost", "intensity", "codes", "pace"),
)
"""Identifiers of findings, in the order of docs/info.md."""
DEEP_IDS = ("mirror", "stamp", "lasers", "flicker")
"""Those that only `--deep` judges."""


@dataclass(frozen=True, slots=True)
class Fix:
    """Text to paste that mends a fault."""

    kind: FixKind
    text: str


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault of a topic."""

    id: str
    """Name of the rule, one of docs/info.md."""
    level: Level
    topic: str
    frame: str
    message: str
    """One line for people; notes print the same line."""
    evidence: Mapping[str, Any] = field(default_factory=dict)
    """Measured quantity → its value, NaN where there was nothing to measure. Metres, radians, seconds, shares."""
    threshold: Mapping[str, Any] = field(default_factory=dict)
    """Quantity → the value from which on it is a fault."""
    fix: Fix | None = None
    mend: str = ""
    """Word of `clean --mend` that mends it in a copy of the log; empty where nothing can."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, which has no NaN."""
        known = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in self.evidence.items()
        }
        return asdict(self) | {"evidence": known}


class Sensor(NamedTuple):
    """Sweeps of one topic and frame."""

    topic: str
    frame: str
    name: str
    """Words for it in messages."""

    def finding(
        self,
        rule: str,
        level: Level,
        message: str,
        evidence: Mapping[str, Any] | None = None,
        threshold: Mapping[str, Any] | None = None,
        option: str = "",
        mend: str = "",
    ) -> Finding:
        """Return a finding of this sensor; `option` mends it on the command line, `mend` in the log."""
        fix = Fix("option", option) if option else None
        return Finding(rule, level, self.topic, self.frame, message, evidence or {}, threshold or {}, fix, mend)


@dataclass(frozen=True, slots=True)
class Rule:
    """The declaration of a finding: when it holds, in which words, by what evidence, and with which remedy.

    Predicate, words and fix take the statistics of a sensor; in words and fix these are `{0}`, and `{name}` is the sensor.
    """

    id: str
    level: Level
    holds: Callable[[Any], Any]
    words: str
    evidence: str = ""
    """Keys, each with `=` and an attribute of the statistics where that has another name; `*name`: all of a mapping."""
    threshold: Mapping[str, Any] = field(default_factory=dict)
    """Key → value from which on the evidence is a fault, or the attribute that has it."""
    fix: str = ""
    """Option of the command line; empty without one."""
    chain: str = ""
    """Of rules of one chain the first that holds counts."""
    unless: Collection[str] = ()
    """Identifiers of findings that make this one redundant."""
    mend: str = ""
    """Word of `clean --mend`; empty where nothing can mend it."""

    def finding(self, stats: Any, sensor: Sensor) -> Finding:
        """Return the finding of this rule, which holds; without an option its fix is that of the statistics, if any."""
        values: dict[str, Any] = {}
        for key, _, name in (part.partition("=") for part in self.evidence.split()):
            values |= getattr(stats, key[1:]) if key[0] == "*" else {key: attrgetter(name or key)(stats)}
        limits = {key: attrgetter(one)(stats) if isinstance(one, str) else one for key, one in self.threshold.items()}
        found = sensor.finding(
            self.id, self.level, self.words.format(stats, name=sensor.name), values, limits, mend=self.mend.format(stats)
        )
        option = self.fix.format(stats)
        return replace(found, fix=Fix("option", option) if option else getattr(stats, "fix", None))


def transform_lines(parent: str, child: str, x: float, y: float, yaw: float) -> str:
    """Return two commands that publish where `child` is in `parent` [m, rad]: that of ROS 2, and that of ROS 1.

    >>> print(transform_lines("base_link", "laser", -0.13, 0.0, 0.0))
    ros2 run tf2_ros static_transform_publisher --x -0.13 --y 0 --z 0 --yaw 0 --frame-id base_link --child-frame-id laser
    rosrun tf2_ros static_transform_publisher -0.13 0 0 0 0 0 base_link laser
    """
    east, north, turn = (f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".") for value in (x, y, yaw))
    outer, inner = shlex.quote(parent), shlex.quote(child)
    program = "tf2_ros static_transform_publisher"
    named = f"--x {east} --y {north} --z 0 --yaw {turn} --frame-id {outer} --child-frame-id {inner}"
    return f"ros2 run {program} {named}\nrosrun {program} {east} {north} 0 {turn} 0 0 {outer} {inner}"
