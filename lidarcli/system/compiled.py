"""Choice between the compiled core of the detection and the same files as plain Python."""

from __future__ import annotations

import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES, FileFinder, SourceFileLoader
from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
MISSING = (
    "the detection is not compiled and takes about fifty times as long; "
    "install a C compiler, then lidarcli again (docs/performance.md)"
)


def is_wanted() -> bool:
    """Return whether to use the compiled core if it is there; `LIDARCLI_COMPILED=no` leaves it out."""
    return os.environ.get("LIDARCLI_COMPILED", "").lower() not in ("no", "0", "false")


def is_there() -> bool:
    """Return whether the compiled core was built for this Python."""
    return any((_PACKAGE / "formalism" / f"core{suffix}").exists() for suffix in EXTENSION_SUFFIXES)


def about_core() -> str:
    """Return the words of `--version` about the core."""
    if is_wanted():
        return "compiled" if is_there() else "not compiled, about fifty times as slow (docs/performance.md)"
    return "not compiled, as LIDARCLI_COMPILED asks for"


def use_source() -> None:
    """Let the core's files be imported as they are written, whatever was built from them."""
    # Spelled as imports do, which look a folder up by its name: a `Path` would leave out a slash too many.
    package = __file__.rsplit(os.sep, 2)[0]
    for folder in {path.parent.relative_to(_PACKAGE) for path in _PACKAGE.rglob("*.pxd")}:
        name = package + "".join(f"{os.sep}{part}" for part in folder.parts)
        sys.path_importer_cache[name] = FileFinder(name, (SourceFileLoader, SOURCE_SUFFIXES))
