"""The metadata.yaml of a ROS 2 bag, as far as it names the files of the bag."""

from __future__ import annotations

import re
import stat
from itertools import takewhile
from pathlib import Path

METADATA = "metadata.yaml"
MAX_METADATA = 16 << 20

_STORAGE = (".db3", ".mcap", ".zstd")
_PATHS = "relative_file_paths:"
_CONFLICT = re.compile(r"^(<{7,}|={7,}|>{7,})", re.MULTILINE)


def is_one_bag(folder: Path) -> bool:
    """Return True for a folder that holds its metadata.yaml, the storage files that this names, and nothing else."""
    named, _ = named_files(folder / METADATA)
    there = sorted(path.name for path in folder.iterdir())
    storage = all(name.lower().endswith(_STORAGE) for name in named)
    return bool(named) and storage and sorted([METADATA, *named]) == there


def named_files(path: Path) -> tuple[list[str], str]:
    """Return file names of a metadata.yaml, and what is wrong with it.

    The names, as they stand there, are all that is wanted of it: they are taken from their lines, which neither a broken
    part elsewhere nor a hostile YAML can spoil.
    """
    try:
        # Whoever opens a pipe waits for its writer.
        if not stat.S_ISREG(path.stat().st_mode):
            return [], f"{METADATA} is no file"
        with path.open("rb") as file:
            text = file.read(MAX_METADATA).decode("utf-8", "replace")
    except FileNotFoundError:
        return [], f"{METADATA} is missing"
    except OSError as err:
        return [], f"{METADATA} cannot be read ({err.strerror})"
    if _CONFLICT.search(text):
        return [], f"{METADATA} holds an unresolved merge conflict"
    names = [item.strip().strip("\"'") for item in _listed(text)]
    names = [name for name in names if name]
    return names, "" if names else f"{METADATA} lists no files"


def _listed(text: str) -> list[str]:
    """Return the items of the list of files: within brackets, or one in a line each."""
    lines = iter(text.split("\n"))
    for line in lines:
        if line.strip().startswith(_PATHS):
            rest = line.strip().removeprefix(_PATHS).strip()
            if rest.startswith("["):
                # Brackets may be closed lines later.
                inside, closed, _ = "\n".join([rest, *lines]).partition("]")
                return inside.strip("[").split(",") if closed else []
            items = takewhile(lambda item: item.strip().startswith(("- ", "-\t")), lines)
            return [item.strip()[2:] for item in items]
    return []
