"""The files that a name, a folder or a pattern stands for, on this machine or in a store."""

from __future__ import annotations

import glob
import os
from enum import Enum
from pathlib import Path, PurePosixPath

from lidarcli.errors import UnreadableError
from lidarcli.stores.url import Place, Url, place


class Named(Enum):
    """What a name turned out to be."""

    FILE = "file"
    FOLDER = "folder"
    PATTERN = "pattern"


def files_named(text: str) -> tuple[Named, list[Place]]:
    """The files by name; below a folder all but those that are hidden (`.`) or nobody's table (`_lidarcli`).

    Raises
    ------
    UnreadableError
        There is no such file or folder, or the store does not say.
    """
    named = place(text)
    if isinstance(named, Url):
        return _stored(named)
    if named.is_dir():
        below = sorted(named.rglob("*.parquet"))
        return Named.FOLDER, [file for file in below if _is_shown(file.relative_to(named))]
    if named.exists():
        return Named.FILE, [named]
    if not glob.has_magic(text):
        raise UnreadableError(f"{text}: no such file or folder")
    return Named.PATTERN, [Path(file) for file in sorted(glob.glob(text, recursive=True))]  # noqa: PTH207


def all_files(folder: Place, suffix: str) -> list[Place]:
    """The files of a folder, by name; none where there is no such folder, `UnreadableError` where nobody may look."""
    if isinstance(folder, Url):
        from lidarcli.stores.store import listing

        return [found for found, _ in listing(folder) if found.name.endswith(suffix)]
    try:
        return [folder / name for name in sorted(os.listdir(folder)) if name.endswith(suffix)]  # noqa: PTH208
    except FileNotFoundError:
        return []
    except OSError as err:
        raise UnreadableError(f"{folder}: cannot be searched: {err.strerror or err}") from err


def _stored(url: Url) -> tuple[Named, list[Place]]:
    from lidarcli.pipeline.inputs.store_search import objects_matching
    from lidarcli.stores.store import has_bucket, listing

    if url.has_magic():
        return Named.PATTERN, [*objects_matching(url)]
    if url.key and url.exists():
        return Named.FILE, [url]
    below = [found for found, _ in listing(url)]
    if not below:
        raise UnreadableError(
            f"{url}: {'no such object or folder' if has_bucket(url) else 'there is no such bucket'}"
        )
    return Named.FOLDER, [
        found for found in below if _is_shown(PurePosixPath(found.key.removeprefix(url.key).strip("/")))
    ]


def _is_shown(path: Path | PurePosixPath) -> bool:
    return not any(part.startswith((".", "_")) for part in path.parts)
