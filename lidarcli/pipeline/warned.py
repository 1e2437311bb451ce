"""Warnings of the Python functions: they name the line of whoever called the package."""

from __future__ import annotations

import sys
import warnings

PACKAGE = __name__.partition(".")[0]


def warn(line: str) -> None:
    """Warn of something that a user should know, at the line outside of the package that led here."""
    level, outside = 1, 1
    frame = sys._getframe(0).f_back
    while frame is not None:
        level += 1
        if frame.f_globals.get("__name__", "").partition(".")[0] == PACKAGE:
            outside = level
        frame = frame.f_back
    warnings.warn(line, stacklevel=outside + 1)
