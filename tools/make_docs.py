"""Write the generated pages of docs/, and the outputs of the examples in the others (`make docs`)."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from tools.examples import demo, renewed
from tools.reference import cli_page, reports_page, tables_page

ROOT = Path(__file__).parent.parent
PAGES: dict[str, Callable[[], str]] = {
    "docs/cli.md": cli_page,
    "docs/tables.md": tables_page,
    "docs/reports.md": reports_page,
}
WITH_EXAMPLES = (
    "README.md",
    "docs/tutorial.md",
    "docs/cheatsheet.md",
    "docs/install.md",
    "docs/questions.md",
    "docs/citing.md",
    "docs/info.md",
    "docs/poses.md",
    "docs/counting.md",
    "docs/lasers.md",
    "docs/clouds.md",
    "docs/map.md",
    "docs/overlay.md",
    "docs/diff.md",
    "docs/zones.md",
    "docs/clean.md",
    "docs/refused.md",
    "docs/background.md",
    "docs/track.md",
    "docs/catalogue.md",
    "docs/paper.md",
    "docs/reports.md",
    "docs/ci.md",
    "docs/settings.md",
)


def main() -> None:
    """Write every page."""
    for name in WITH_EXAMPLES:
        page_path = ROOT / name
        with tempfile.TemporaryDirectory() as name_of_folder:
            folder = Path(name_of_folder)
            if name == "README.md":
                folder = demo(folder)
            else:
                (folder / "samples").symlink_to(ROOT / "samples")
            page_path.write_text(renewed(page_path.read_text(encoding="utf-8"), folder), encoding="utf-8")
    for name, page in PAGES.items():
        (ROOT / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
