"""Masks as parameters of ROS's laser_filters (YAML)."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np

from lidarcli.display.texts import visible
from lidarcli.errors import OptionError
from lidarcli.sweeps.masks import CLOSE, Masks, Sector, same_name
from lidarcli.sweeps.types import TURN

NODE = "scan_to_scan_filter_chain"
"""Program of laser_filters, and the name of its node."""


class View(NamedTuple):
    """Bearings of the beams of a topic, from the least to the greatest [rad]."""

    topic: str
    low: float
    high: float


def filter_text(masks: Masks, views: Sequence[View]) -> str:
    """Return the parameters of a node for each topic with a mask, as YAML (`OptionError` for masks that are no sectors)."""
    chains = {}
    for view in views:
        own = [mask.shape for mask in masks.masks if not mask.topic or same_name(mask.topic, view.topic)]
        if filters := [each for shape in own for each in _filters(shape, view)]:
            chains[view.topic] = filters
    blocks: dict[str, str] = {}
    for topic, filters in chains.items():
        stem = re.sub("[^0-9A-Za-z]+", "_", topic).strip("_")
        several = (f"{stem}{'_' * bool(n)}{n or ''}_filter_chain" for n in count())
        node = NODE if len(chains) == 1 else next(name for name in several if name not in blocks)
        named = "" if len(chains) == 1 else f" -r __node:={node}"
        remap = shlex.quote(visible(f"scan:={topic}"))
        lines = [
            f"# ros2 run laser_filters {NODE} --ros-args -r {remap}{named} --params-file FILE",
            f"{node}:",
            "  ros__parameters:",
        ]
        for number, parameters in enumerate(filters, 1):
            lines += [
                f"    filter{number}:",
                f"      name: mask{number}",
                "      type: laser_filters/LaserScanSectorFilter",
                "      params:",
                *(f"        {key}: {value}" for key, value in parameters.items()),
            ]
        blocks[node] = "".join(f"{line}\n" for line in lines)
    return "\n".join(blocks.values())


def _filters(shape: object, view: View) -> Iterator[dict[str, str]]:
    """Yield the parameters of the filters for one mask of a sensor."""
    if not isinstance(shape, Sector):
        raise OptionError("laser_filters takes sectors of bearings; write other masks to a .toml file")
    width = shape.end - shape.begin if 0.0 <= shape.end - shape.begin <= TURN else (shape.end - shape.begin) % TURN
    # A filter knows nothing of turns; a mask and a sensor may count their bearings from different ones.
    first = shape.begin + TURN * np.ceil((view.low - shape.begin - width - CLOSE) / TURN)
    while first <= view.high + CLOSE:
        # A filter takes what lies between its limits, and a mask these, too.
        yield {
            "angle_min": f"{first - CLOSE:.10f}",
            "angle_max": f"{first + width + CLOSE:.10f}",
            "range_min": _beyond(shape.nearest, -np.inf),
            "range_max": _beyond(shape.farthest, np.inf),
        }
        first += TURN


def _beyond(edge: float, side: float) -> str:
    """Return a limit between a range [m] and the next float32 to a side."""
    value = np.float32(edge)
    return f"{0.5 * (float(value) + float(np.nextafter(value, np.float32(side)))):#.10g}"
