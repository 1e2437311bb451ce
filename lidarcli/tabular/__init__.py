"""Everything written is a table with a declared schema: schemas, rows, atomic streaming writers."""

from lidarcli.tabular.schemas import BEAMS, OBJECTS, SCHEMAS, SWEEPS, TRACKS

__all__ = ["BEAMS", "OBJECTS", "SCHEMAS", "SWEEPS", "TRACKS"]
