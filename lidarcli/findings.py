"""Findings: faults of the sweeps or poses of a log, each with its evidence, its threshold and a fix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Level = Literal["error", "warning", "hint"]
"""`error`: tables of this log would be wrong; `warning`: they may be; `hint`: good to know."""
FixKind = Literal["option", "transform", "mask", "mount"]


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
    """Measured quantity → its value. Metres, radians, seconds, shares."""
    threshold: Mapping[str, Any] = field(default_factory=dict)
    """Quantity → the value from which on it is a fault."""
    fix: Fix | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "id": self.id,
            "level": self.level,
            "topic": self.topic,
            "frame": self.frame,
            "message": self.message,
            "evidence": dict(self.evidence),
            "threshold": dict(self.threshold),
            "fix": None if self.fix is None else {"kind": self.fix.kind, "text": self.fix.text},
        }


def transform_lines(parent: str, child: str, x: float, y: float, yaw: float) -> str:
    """Return the two commands, of ROS 2 and of ROS 1, that tell where a frame is mounted [m, rad]."""
    place = [f"{round(one, 4) + 0.0:g}" for one in (x, y, yaw)]
    return (
        "ros2 run tf2_ros static_transform_publisher "
        f"--x {place[0]} --y {place[1]} --z 0 --yaw {place[2]} --frame-id {parent} --child-frame-id {child}\n"
        f"rosrun tf2_ros static_transform_publisher {place[0]} {place[1]} 0 {place[2]} 0 0 {parent} {child}"
    )
