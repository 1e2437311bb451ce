"""Print what pyproject.toml asks for, a line each: `python -m tools.requirements build-system` or the name of an extra."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).parent.parent / "pyproject.toml"


def requirements(name: str) -> list[str]:
    """What is needed to build, or for an extra."""
    told = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))
    needed: list[str] = (
        told["build-system"]["requires"] if name == "build-system" else told["project"]["optional-dependencies"][name]
    )
    return needed


if __name__ == "__main__":
    print("\n".join(requirements(sys.argv[1])))
