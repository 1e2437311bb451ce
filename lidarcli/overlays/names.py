"""Names of topics and frames that every viewer takes."""

from __future__ import annotations

import re
from collections.abc import Iterable

OBJECTS, MAP = "/lidarcli/objects", "/lidarcli/map"
FRAME = "laser"
"""The frame of a sensor whose log names none."""


def topic_name(text: str) -> str:
    """A topic of a log that need not be ROS, as ROS has it.

    >>> topic_name("front scan"), topic_name("/2d/scan")
    ('/front_scan', '/_2d/scan')
    """
    parts = [re.sub(r"[^A-Za-z0-9_]", "_", part) for part in text.split("/") if part]
    return "".join(f"/{'_' * part[:1].isdigit()}{part}" for part in parts) or "/scan"


def topics_of_objects(topics: Iterable[str]) -> dict[str, str]:
    """Topic of sweeps → that of its markers: one for each, for a message deletes all that its topic has shown before.

    >>> topics_of_objects(["/scan"])
    {'/scan': '/lidarcli/objects'}
    >>> topics_of_objects(["/front", "/rear"])
    {'/front': '/lidarcli/objects/front', '/rear': '/lidarcli/objects/rear'}
    """
    names = sorted(set(topics))
    if len(names) == 1:
        return {names[0]: OBJECTS}
    named: dict[str, str] = {}
    for name in names:
        mine = wanted = f"{OBJECTS}{topic_name(name)}"
        number = 1
        while mine in named.values():
            number += 1
            mine = f"{wanted}_{number}"
        named[name] = mine
    return named
