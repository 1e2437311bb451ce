"""The section of one version in CHANGELOG.md, for the page of its release: `python -m tools.changelog 0.2.0`."""

from __future__ import annotations

import re
import sys
from pathlib import Path

CHANGELOG = Path(__file__).resolve().parent.parent / "CHANGELOG.md"


def section(version: str, text: str) -> str:
    """What stands below the heading `## [version] - date`, up to the next version.

    Raises
    ------
    ValueError
        The version has no such heading, or nothing stands below it.

    >>> section("0.2.0", "# Log\\n\\n## [0.2.0] - 2026-01-01\\n\\n- New.\\n\\n## [0.1.0] - 2025-01-01\\n\\n- Old.\\n")
    '- New.\\n'
    >>> section("0.3.0", "## [Unreleased]\\n\\n- New.\\n")
    Traceback (most recent call last):
    ValueError: no heading `## [0.3.0] - YYYY-MM-DD`
    """
    heading = re.compile(rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d\n", re.MULTILINE)
    found = heading.search(text)
    if found is None:
        raise ValueError(f"no heading `## [{version}] - YYYY-MM-DD`")
    below = text[found.end() :].split("\n## [")[0].strip()
    if not below:
        raise ValueError(f"nothing stands below `## [{version}]`")
    return below + "\n"


def main(version: str) -> None:
    """Print the section, or end with a line on why there is none."""
    try:
        print(section(version, CHANGELOG.read_text("utf-8")), end="")
    except ValueError as error:
        sys.exit(f"{CHANGELOG.name}: {error}")


if __name__ == "__main__":
    main(sys.argv[1])
