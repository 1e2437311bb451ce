"""Which lidarcli this is, for the question whether another machine would write the same bytes."""

from __future__ import annotations

import sys
from functools import cache
from hashlib import blake2b
from pathlib import Path

from lidarcli import compiled
from lidarcli._version import __version__


@cache
def build() -> dict[str, str]:
    """What the bytes of tables may depend on beside the log and the parameters."""
    import numpy as np
    import pyarrow as pa

    package = Path(compiled.__file__).parent
    digest = blake2b(digest_size=4)
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return {
        "lidarcli": f"{__version__} ({digest.hexdigest()})",
        "Python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "core": "compiled" if compiled.is_wanted() and compiled.is_there() else "not compiled",
        "numpy": np.__version__,
        "pyarrow": pa.__version__,
    }
