"""Whether the core of the detection runs compiled, or the same files as plain Python."""

from __future__ import annotations

import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES, FileFinder, SourceFileLoader
from pathlib import Path

_FORMALISM = Path(__file__).parent / "formalism"
MISSING = (
    "the compiled core is missing, so the detection takes some 200 times as long; "
    "to get it, install a C compiler and then lidarcli again: pip install --force-reinstall --no-deps lidarcli"
)


def is_wanted() -> bool:
    """Whether the compiled core is to be used where it is there: `LIDARCLI_COMPILED=no` leaves it out."""
    return os.environ.get("LIDARCLI_COMPILED", "").lower() not in ("no", "0", "false")


def is_there() -> bool:
    """Whether it was built."""
    return any((_FORMALISM / f"core{suffix}").exists() for suffix in EXTENSION_SUFFIXES)


def use_source() -> None:
    """Let the core's files be imported as they are written, whatever was built from them."""
    for folder in (_FORMALISM, *(path for path in _FORMALISM.iterdir() if path.is_dir())):
        sys.path_importer_cache[str(folder)] = FileFinder(str(folder), (SourceFileLoader, SOURCE_SUFFIXES))
