"""What a sweep says for and against a body being a thing: numbers with names, on which `verdict` decides.

A wall goes on: in the direction of the building, on its own line, behind what hides it. A thing ends: at steps, before free
space. Every feature is one such question, put to the whole sweep.
"""

from __future__ import annotations

from typing import Any

from lidarcli import native
from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces.fragments import Bodies
from lidarcli.formalism.surfaces.survey import Survey

NAMES = (
    "jump_least",
    "jump_most",
    "hidden",
    "open",
    "width",
    "reach",
    "beams",
    "aligned",
    "support",
    "support_near",
    "backing",
    "line",
    "line_behind",
    "depth_behind",
    "line_before",
    "unbroken",
    "cross_line",
    "bulge_to",
    "bulge_away",
    "before_back",
    "walls",
    "noise",
    "grazing",
    "protrusion",
    "roughness",
    "view",
    "range",
    "flicker",
    "first",
    "jump_free",
    "hidden_by_wall",
    "hidden_by_thing",
    "others",
)
"""The features in their order (docs/formalism.md says what each is)."""
(
    JUMP_LEAST,
    JUMP_MOST,
    HIDDEN,
    OPEN,
    WIDTH,
    REACH,
    BEAMS,
    ALIGNED,
    SUPPORT,
    SUPPORT_NEAR,
    BACKING,
    LINE,
    LINE_BEHIND,
    DEPTH_BEHIND,
    LINE_BEFORE,
    UNBROKEN,
    CROSS_LINE,
    BULGE_TO,
    BULGE_AWAY,
    BEFORE_BACK,
    WALLS,
    NOISE,
    GRAZING,
    PROTRUSION,
    ROUGHNESS,
    VIEW,
    RANGE,
    FLICKER,
    FIRST,
    JUMP_FREE,
    HIDDEN_BY_WALL,
    HIDDEN_BY_THING,
    OTHERS,
    COUNT,
) = range(34)

FAR = 3.0
"""[m] The jump at an edge behind which nothing is seen; none counts as larger."""
NEARER = -2.0
"""[m] None counts as less."""
BINS = 52
"""Depths before and behind a line that are told apart."""


class Features:
    """The bodies of a sweep on which a decision is due, and what is known of each."""

    def __init__(self, most: int) -> None:
        """Room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.count = 0
        self.head = native.integers(self.owner, most)
        """First segment of each body."""
        self.tail = native.integers(self.owner, most)
        """Last segment of each body."""
        self.values = native.doubles(self.owner, COUNT * most)
        """`COUNT` features of each body, as `NAMES` lists them."""
        self.body = native.integers(self.owner, most)
        """Of each segment, the body that it belongs to; -1 for none."""
        # Of each face: whether it is aligned, with which axis, its offset from the sensor, where it begins and ends.
        self.aligned = native.integers(self.owner, 2 * most)
        self.axis = native.integers(self.owner, 2 * most)
        self.offset = native.doubles(self.owner, 2 * most)
        self.low = native.doubles(self.owner, 2 * most)
        self.high = native.doubles(self.owner, 2 * most)
        self.cos = 1.0
        """The direction of the building."""
        self.sin = 0.0
        self.angle = native.doubles(self.owner, 2 * most)
        self.chosen = native.integers(self.owner, 2 * most)
        self.bins = native.doubles(self.owner, BINS + 1)
        self.goes_on = 0.0
        """[m] How far a line goes on past the ends of a body without a beam that passes through it."""
        self.share = 0.0
        """Share of the points of the sweep that are on walls."""


def gather(features: Features, survey: Survey, points: Points, segments: Segments, bodies: Bodies) -> None:
    """List the bodies that may be things: their segments are candidates, with points enough and no wider than an object."""
    features.count = 0
    for j in range(segments.count):
        features.body[j] = -1
    for j in range(segments.count):
        if not survey.candidate[j] or features.body[j] >= 0:
            continue
        if bodies.size[j] < survey.min_beams or not bodies.reach[j] <= survey.max_width:
            continue
        before = segmentation.preceding(segments, points, j)
        # A body begins where none joins it from before; one that goes all around, anywhere.
        if bodies.joins[before] and before != j and bodies.parts[j] < segments.count:
            continue
        k, tail = features.count, j
        features.head[k] = j
        features.body[j] = k
        for _ in range(bodies.parts[j] - 1):
            tail = segmentation.following(segments, points, tail)
            features.body[tail] = k
        features.tail[k] = tail
        features.count += 1
