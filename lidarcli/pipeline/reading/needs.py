"""What a command needs of the poses of a log, and what its user chose of them."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidarcli.errors import OptionError
from lidarcli.options.choices import BEAM_ORDERS, MATCH, MAX_DELAY
from lidarcli.sweeps.zone import ROBOT
from lidarcli.system.records import dataclass

if TYPE_CHECKING:
    from lidarcli.pose.sources import GivenPaths


UNPLACED = 0.05
"""Share of the sweeps without a pose up to which this is routine."""
NONE = "none"
"""Value of `--pose` for no poses at all."""


def of_one_run(world: str) -> bool:
    """Return whether a world frame begins again in every run: that of odometry, or of a path that was matched.

    >>> [of_one_run(name) for name in ("odom", "robot_0/odom", "match", "r1/robot", "map")]
    [True, True, True, True, False]
    """
    return "odom" in world or world.rpartition("/")[2] in (MATCH, ROBOT)


class SensorMovedError(Exception):
    """A sensor that was taken to be static moves, or there are two: the log has to be read again."""


class Need(Enum):
    """Sensors whose path a command needs."""

    NONE = "none"
    """None: the sweeps are not looked at."""
    TOLD = "told"
    """None but those whose path the log has."""
    STANDING = "standing"
    """Those of moving sensors, but an only one is taken to be static: `SensorMovedError` where it moves."""
    MOVING = "moving"
    """Those of moving sensors as well."""
    ALL = "all"
    """Those of all sensors."""


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """Options for the poses of sweeps: their source, their delay and their use."""

    source: str | None = None
    """Topic of the poses; `none` for no poses; `match` for poses matched from the sweeps; None: the best of the log."""
    file: str | None = None
    """Trajectory of the sensor (TUM), instead of the poses of the log."""
    delay: float | None = None
    """Time after its header stamp at which the pose of a sweep is taken [s]; None: what fits the sweeps."""
    order: str = BEAM_ORDERS[0]
    """Order in which the beams of a sweep are sent, of `BEAM_ORDERS`."""
    deskew: bool = True
    """True to place every beam by the pose at its own time, where headers state how long a sweep takes."""
    given: GivenPaths | None = None
    """Paths that are known already, in place of all others."""
    on_map: bool = False
    """True where a map evaluates the path: that which the log gives of the robot on its map, as it is."""
    together: bool = False
    """True where sensors of one robot are followed together, in one world."""

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        if self.delay is None:
            return
        if not abs(self.delay) <= MAX_DELAY:
            raise OptionError(f"--pose-delay: {self.delay:g} s is not within {MAX_DELAY:,.0f} s")
        if self.source == NONE and self.delay:
            raise OptionError("--pose-delay is for poses, and --pose none leaves them out")
        if self.source == MATCH and self.delay:
            raise OptionError("--pose-delay is for poses of the log, and --pose match finds them in its sweeps")

    def as_dict(self) -> dict[str, Any]:
        """Return the options that are not the default, as plain values, for the tables' metadata."""
        requested = {"pose": self.source, "poses": self.file and Path(self.file).name}
        given: dict[str, Any] = {name: value for name, value in requested.items() if value is not None}
        if self.delay:
            given["pose_delay"] = self.delay
        if self.order != BEAM_ORDERS[0]:
            given["beam_order"] = self.order
        return given if self.deskew else given | {"deskew": False}


NO_POSES = PoseOptions(NONE)
