"""Files that have their name only when they are whole."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path

from lidarcli.errors import OutputError
from lidarcli.tables.parquet import unwritable


def refuse(paths: Iterable[Path], overwrite: bool) -> None:
    """Refuse files that exist, before any work is done."""
    for path in paths:
        if path.exists() and not overwrite:
            raise OutputError(f"{path} exists; use --overwrite to replace it")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under a temporary name beside its own, then give it its name."""
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(data)
        part.replace(path)
    except OSError as err:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise unwritable(path, err) from err
