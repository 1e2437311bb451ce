"""Write the generated pages of docs/ (`make docs`)."""

from __future__ import annotations

from pathlib import Path

from reference import cli_page, tables_page

DOCS = Path(__file__).parent.parent / "docs"
PAGES = {"cli.md": cli_page, "tables.md": tables_page}


def main() -> None:
    """Write every page."""
    for name, page in PAGES.items():
        (DOCS / name).write_text(page(), encoding="utf-8")
        print(DOCS.name, name, sep="/")


if __name__ == "__main__":
    main()
