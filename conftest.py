"""Doctests are collected from source files; a module that was compiled from one would be imported in its place."""

from __future__ import annotations

from pathlib import Path

from lidarcli import compiled

collect_ignore_glob = (
    [str(path.with_suffix(".py")) for path in Path(__file__).parent.glob("lidarcli/**/*.pxd")]
    if compiled.is_there() and compiled.is_wanted()
    else []
)
