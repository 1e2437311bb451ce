"""Draws samples/two_lasers.zip: a robot with a scanner at each of two corners drives a round, and two people walk past it.

It is packed, so that a run over all logs of the folder reads those of one sensor each.
"""

from __future__ import annotations

import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, super_ellipse
from tests.robots import CORNERS, robot_log
from tests.zones.runs import scene_of, walker

SAMPLE = Path(__file__).parents[1] / "samples" / "two_lasers.zip"
HALL = make.wall([[-6.0, -5.0], [6.0, -5.0], [6.0, 3.0], [3.0, 3.0], [3.0, 5.0], [-6.0, 5.0], [-6.0, -5.0]])
THINGS = (make.box(-4.5, 3.5, 0.8, 0.5), make.cylinder(4.5, -3.8, 0.25), make.box(5.0, 1.5, 0.5, 0.5))
PEOPLE = (walker((-4.5, 2.4), (4.0, 2.6)), walker((4.5, -2.6), (-4.0, -2.4)))
"""Each walks from the view of one sensor into that of the other."""


def draw() -> bytes:
    """Return the log."""
    course = Course(super_ellipse(1.2, 0.9, 2.5), speed=0.5)
    scene = scene_of(*THINGS, *PEOPLE, room=(HALL,), sweeps=80, path=course)
    carried = [one._replace(sensor=replace(one.sensor, resolution=0.01)) for one in CORNERS]
    with tempfile.TemporaryDirectory() as folder:
        return robot_log(Path(folder) / "run.bag", scene, carried).read_bytes()


if __name__ == "__main__":
    with zipfile.ZipFile(SAMPLE, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr(zipfile.ZipInfo("two_lasers.bag"), draw(), zipfile.ZIP_DEFLATED)
