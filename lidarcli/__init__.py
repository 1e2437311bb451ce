"""From a 2D LiDAR log to a table of objects: the public Python API.

>>> import lidarcli
>>> objects = lidarcli.detect("run.mcap")  # doctest: +SKIP
>>> objects, sweeps, tracks = lidarcli.track("run.mcap")  # doctest: +SKIP
>>> grid = lidarcli.map("run.mcap", "room.yaml")  # doctest: +SKIP
>>> for batch in lidarcli.read("run.mcap"):  # doctest: +SKIP
...     print(batch.topic, batch.ranges.shape)
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from lidarcli._version import __version__

if "LIDARCLI_COMPILED" in os.environ:
    from lidarcli import compiled

    if not compiled.is_wanted():
        compiled.use_source()

if TYPE_CHECKING:
    from lidarcli import formalism
    from lidarcli.pipeline.api import detect, learn, map, read, track

__all__ = ["__version__", "detect", "formalism", "learn", "map", "read", "track"]


def __getattr__(name: str) -> Any:
    """Import on first use, so that `import lidarcli` and `lidarcli --help` stay light."""
    if name in ("detect", "learn", "map", "read", "track"):
        return getattr(import_module("lidarcli.pipeline.api"), name)
    if name == "formalism":
        return import_module("lidarcli.formalism")
    raise AttributeError(f"module 'lidarcli' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
