"""What a user may say of poses: where they come from, how late they are, and whether sweeps take time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lidarcli.choices import MATCH
from lidarcli.errors import OptionError

NONE = "none"
"""What `--pose` takes for no poses at all."""
MOST_DELAY = 3600.0
"""Greatest `--pose-delay` [s], either way: what is more is another clock."""

_ODOMETRY = "odom"
"""A world whose name holds this begins anew in every run …"""


def of_one_run(world: str) -> bool:
    """Whether a world frame begins anew in every run: that of odometry, or of a path that was matched.

    >>> [of_one_run(name) for name in ("odom", "robot_0/odom", "match", "map")]
    [True, True, True, False]
    """
    return _ODOMETRY in world or world == MATCH


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """Where the poses of the sweeps come from, and how they are used."""

    source: str | None = None
    """Topic whose poses to take; `none` for no poses; `match` for those that the sweeps themselves tell; by default the
    best that the log has."""
    file: str | None = None
    """Trajectory of the sensor (TUM), instead of what the log tells."""
    delay: float | None = None
    """The pose of a sweep is that at its header stamp and this much later [s]; None: nobody has asked for any, and things
    are followed by the delay that fits best."""
    deskew: bool = True
    """Whether every beam is seen from where the sensor was at its own time, where headers tell how long a sweep takes."""

    def __post_init__(self) -> None:
        """Refuse what no log could be read with."""
        if self.source is not None and self.file is not None:
            raise OptionError(
                f"--pose {self.source} and --poses {self.file} exclude each other: leave one out"
            )
        if self.delay is None:
            return
        if not abs(self.delay) <= MOST_DELAY:
            raise OptionError(f"--pose-delay: {self.delay:g} s is not within {MOST_DELAY:,.0f} s")
        if self.source == NONE and self.delay:
            raise OptionError("--pose-delay is for poses, and --pose none leaves them out")
        if self.source == MATCH and self.delay:
            raise OptionError(
                "--pose-delay is for poses of the log, and --pose match finds them in its sweeps"
            )

    def as_dict(self) -> dict[str, Any]:
        """What the result depends on, as plain values, for the tables' metadata: what is not the default."""
        asked = {"pose": self.source, "poses": self.file and Path(self.file).name}
        told: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
        if self.delay:
            told["pose_delay"] = self.delay
        return told if self.deskew else told | {"deskew": False}


NO_POSES = PoseOptions(NONE)
