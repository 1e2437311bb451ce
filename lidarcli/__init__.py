"""From a 2D LiDAR log to a table of objects: the public Python API (docs/python.md).

>>> import lidarcli
>>> objects = lidarcli.detect("run.mcap", max_width=1.5)  # doctest: +SKIP
>>> objects, sweeps, tracks = lidarcli.track("run.mcap")  # doctest: +SKIP
>>> frames = lidarcli.tables("run.mcap")  # doctest: +SKIP
>>> for batch in lidarcli.read("run.mcap", topic="/scan"):  # doctest: +SKIP
...     print(batch)
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from lidarcli._version import __version__

if "LIDARCLI_COMPILED" in os.environ:
    from lidarcli.system import compiled

    if not compiled.is_wanted():
        compiled.use_source()

if TYPE_CHECKING:
    from lidarcli import formalism
    from lidarcli.errors import LidarcliError, NoScanError, OptionError, OutputError, UnreadableError
    from lidarcli.formalism.background import Background
    from lidarcli.formalism.mapping.grid import Occupancy
    from lidarcli.formalism.matching.catalogue import Catalogue
    from lidarcli.formalism.parameters import Parameters
    from lidarcli.pipeline.api.logs import background, clean, diff, info, map, overlay, poses, read, simulate, zones
    from lidarcli.pipeline.api.showing import RunReport, plot, report
    from lidarcli.pipeline.api.tables import Tables, detect, export, tables, track
    from lidarcli.pipeline.detecting import TrackTables
    from lidarcli.pipeline.differences.changes import Difference
    from lidarcli.pipeline.inputs.catalogue import read_catalogue
    from lidarcli.pipeline.zones.summary import ZoneTables
    from lidarcli.simulation.run import Simulated
    from lidarcli.sweeps.types import Status, SweepBatch, SweepPoses

_OF_LOGS = ("background", "clean", "diff", "info", "map", "overlay", "poses", "read", "simulate", "zones")
_HOMES = {
    "lidarcli.errors": ("LidarcliError", "NoScanError", "OptionError", "OutputError", "UnreadableError"),
    "lidarcli.formalism.background": ("Background",),
    "lidarcli.formalism.matching.catalogue": ("Catalogue",),
    "lidarcli.formalism.mapping.grid": ("Occupancy",),
    "lidarcli.formalism.parameters": ("Parameters",),
    "lidarcli.pipeline.api.logs": _OF_LOGS,
    "lidarcli.pipeline.api.showing": ("RunReport", "plot", "report"),
    "lidarcli.pipeline.api.tables": ("Tables", "detect", "export", "tables", "track"),
    "lidarcli.pipeline.detecting": ("TrackTables",),
    "lidarcli.pipeline.differences.changes": ("Difference",),
    "lidarcli.pipeline.inputs.catalogue": ("read_catalogue",),
    "lidarcli.pipeline.zones.summary": ("ZoneTables",),
    "lidarcli.simulation.run": ("Simulated",),
    "lidarcli.sweeps.types": ("Status", "SweepBatch", "SweepPoses"),
}
"""Module → the public names that it holds, as type checkers see them above; each is imported on first use."""
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", "formalism", "read_catalogue"]
__all__ += ["LidarcliError", "NoScanError", "OptionError", "OutputError", "UnreadableError"]
__all__ += ["Background", "Catalogue", "Difference", "Occupancy", "Parameters", "RunReport", "Simulated", "Status"]
__all__ += ["SweepBatch", "SweepPoses", "Tables", "TrackTables", "ZoneTables"]
__all__ += ["background", "clean", "detect", "diff", "export", "info", "map", "overlay", "plot", "poses"]
__all__ += ["read", "report", "simulate", "tables", "track", "zones"]


def __getattr__(name: str) -> Any:
    """Import on first use, so that `import lidarcli` and `lidarcli --help` stay light."""
    if name == "formalism":
        return import_module("lidarcli.formalism")
    if name in _HOME:
        # Kept, so that the next use asks nobody.
        return globals().setdefault(name, getattr(import_module(_HOME[name]), name))
    raise AttributeError(f"module 'lidarcli' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
