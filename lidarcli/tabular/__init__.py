"""Tables: their declared schemas, rows, atomic streaming writers, and readers that check them."""

from lidarcli.tabular.schemas import BEAMS, OBJECTS, SCHEMAS, SWEEPS, TRACKS, TRAJECTORIES

__all__ = ["BEAMS", "OBJECTS", "SCHEMAS", "SWEEPS", "TRACKS", "TRAJECTORIES"]
