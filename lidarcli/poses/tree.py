"""The tree of frames: which links lead from one frame to another."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lidarcli.poses.motion import Motion, compose, inverse
from lidarcli.poses.tracks import Track
from lidarcli.sweeps import Int64

WORLDS = ("map", "odom", "world", "camera_init")
"""Names of fixed frames, the better one first; a prefix (robot_0/odom) does not matter."""


BASES = ("base_footprint", "base_link", "base")
"""Names of the frame of the robot itself, the one on the floor first."""


class Step(NamedTuple):
    """A link on the way from a frame to another one."""

    track: Track
    down: bool
    """From the parent to the child, against the direction in which the link speaks."""

    @property
    def target(self) -> str:
        """The frame that the step leads to."""
        return self.track.child if self.down else self.track.parent

    @property
    def source(self) -> str:
        """The frame that the step comes from."""
        return self.track.parent if self.down else self.track.child


def along(steps: Sequence[Step], stamp_ns: Int64, *, held: bool = False) -> Motion:
    """The pose of the frame that the steps begin at in the one that they lead to, at each time (S,).

    NaN outside the span of any link that moves; `held`: there its first or last pose, as a mount stays where it is.
    """
    count = len(stamp_ns)
    pose = Motion(np.zeros((count, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    for track, down in steps:
        link = track.at(np.clip(stamp_ns, *track.span_ns) if held else stamp_ns)
        pose = compose(inverse(link) if down else link, pose)
    return pose


class FrameTree:
    """The links of a log, both ways."""

    def __init__(self, links: Sequence[Track]) -> None:
        self._near: dict[str, dict[str, Step]] = {}
        self._parent: dict[str, Track] = {}
        for track in sorted(links, key=lambda link: (not link.static, -link.messages)):
            if track.parent == track.child or not track.parent or not track.child:
                continue
            # Of two links that join the same frames the better one has come first.
            self._near.setdefault(track.child, {}).setdefault(track.parent, Step(track, down=False))
            self._near.setdefault(track.parent, {}).setdefault(track.child, Step(track, down=True))
            self._parent.setdefault(track.child, track)

    def path(self, start: str, target: str, avoid: Collection[str] = ()) -> tuple[Step, ...] | None:
        """The shortest way between two frames, empty if they are one; None if there is none."""
        reached = self._reached(start, avoid)
        return _way(reached, target) if target in reached else None

    def to_world(self, start: str) -> tuple[Step, ...] | None:
        """The way to the best fixed frame: `WORLDS` in their order, else the root of the tree; None without one.

        The root counts only if something on the way to it moves and it is not the robot itself (base_link): a tree that
        ends at the robot says nothing of the world.
        """
        if _last(start) in WORLDS:
            return None
        reached = self._reached(start)
        if (world := _named(reached, WORLDS)) is not None:
            return _way(reached, world)
        climbed: list[Step] = []
        seen = {start}
        frame = start
        while (link := self._parent.get(frame)) is not None and link.parent not in seen:
            climbed.append(Step(link, down=False))
            frame = link.parent
            seen.add(frame)
        moves = any(not step.track.static for step in climbed)
        return tuple(climbed) if moves and not _last(frame).startswith("base") else None

    def to_base(self, start: str) -> tuple[Step, ...]:
        """The way to the robot itself: to the best of `BASES`, else to the last frame that is fixed to `start`.

        From a fixed frame without one of these it is the way to what moves there, unless several do.
        """
        in_world = _last(start) in WORLDS
        # Beyond a fixed frame there are other robots.
        reached = self._reached(start, () if in_world else self._worlds())
        if (base := _named(reached, BASES)) is not None:
            return _way(reached, base)
        if in_world:
            moving = _moving(reached)
            return _way(reached, moving[0]) if len(moving) == 1 else ()
        climbed: list[Step] = []
        frame = start
        while (link := self._parent.get(frame)) is not None and link.static and len(climbed) < len(reached):
            climbed.append(Step(link, down=False))
            frame = link.parent
        return tuple(climbed)

    def _worlds(self) -> set[str]:
        return {frame for frame in self._near if _last(frame) in WORLDS}

    def _reached(self, start: str, avoid: Collection[str] = ()) -> dict[str, Step | None]:
        """Every frame that can be reached, the nearest first, with the step that leads to it."""
        found: dict[str, Step | None] = {start: None}
        waiting = deque([start])
        while waiting:
            for neighbour, step in self._near.get(waiting.popleft(), {}).items():
                if neighbour not in found and neighbour not in avoid:
                    found[neighbour] = step
                    waiting.append(neighbour)
        return found


def _way(reached: Mapping[str, Step | None], target: str) -> tuple[Step, ...]:
    """The steps to a frame that can be reached, from the start on."""
    steps: list[Step] = []
    while (step := reached[target]) is not None:
        steps.append(step)
        target = step.source
    return tuple(reversed(steps))


def _moving(reached: Mapping[str, Step | None]) -> list[str]:
    """The frames that move in a fixed one and that no other moving thing carries; the nearest frames come first."""
    carried: set[str] = set()
    found = []
    for frame, step in reached.items():
        if step is None:
            continue
        if step.source in carried:
            carried.add(frame)
        elif not step.track.static and _last(frame) not in WORLDS:
            carried.add(frame)
            found += [frame] if step.down else []
    return found


def _named(frames: Iterable[str], names: Sequence[str]) -> str | None:
    """The frame that has the best of some names, whatever its prefix; the first of several."""
    known = [frame for frame in frames if _last(frame) in names]
    return min(known, key=lambda frame: names.index(_last(frame)), default=None)


def _last(frame: str) -> str:
    return frame.rpartition("/")[2]
