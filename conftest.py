"""What the core's files, compiled or not, ask of a test run."""

from __future__ import annotations

import os
from pathlib import Path

from lidarcli import compiled

CORE = sorted(Path(__file__).parent.glob("lidarcli/**/*.pxd"))

if compiled.is_there() and compiled.is_wanted():
    # Doctests are collected from files; a module that was compiled from one would be imported in its place.
    collect_ignore_glob = [str(path.with_suffix(".py")) for path in CORE]
    for path in CORE:
        for built in path.parent.glob(f"{path.stem}.*.so"):
            newest = max(path.stat().st_mtime, path.with_suffix(".py").stat().st_mtime)
            if built.stat().st_mtime < newest:
                raise SystemExit(f"{built.name} is older than its source: make check compiles it again")
else:
    # Where it could not be compiled, what commands say about that is nothing that their tests expect.
    os.environ.setdefault("LIDARCLI_COMPILED", "no")
