"""How `make site` makes a site of the Markdown pages.

The source folder is the one that `tools.site` fills: the pages of the repository, with README.md as index, and those that
are made of the code. The navigation is docs/README.md: one group for each of its headings, in the order of its lists.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from pygments.lexers.special import TextLexer

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).parent.parent
INDEX = ROOT / "docs" / "README.md"
BADGE = re.compile(r"\[?!\[[^]]*\]\(https?:[^)]*\)(\]\([^)]*\))?")
"""A picture that lies elsewhere, with its link. The pages of the site load nothing from elsewhere."""

BELOW = {"docs/cli": "commands/*", "docs/python": "reference", "docs/tables": "truth", "docs/formalism": "constants"}
"""Page → those that are made of the code and belong below it."""
COMMAND = re.compile(r"`lidarcli ([a-z]+(?: [a-z]+)?) --help-all`")


def groups(index: str) -> dict[str, dict[str, str]]:
    """The headings of the index, each with the pages that its list leads to: path below ROOT -> name."""
    return {
        part.splitlines()[0]: {
            (INDEX.parent / page).resolve().relative_to(ROOT).as_posix(): name
            for name, page in re.findall(r"^- \[([^]]*)\]\(([^):]+\.md)\)", part, re.MULTILINE)
        }
        for part in index.split("\n## ")[1:]
    }


GROUPS = groups(INDEX.read_text(encoding="utf-8"))

project = "lidarcli"
(release,) = re.findall(r'__version__ = "(.+)"', (ROOT / "lidarcli" / "_version.py").read_text(encoding="utf-8"))

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
root_doc = "index"
include_patterns = ["index.md", "docs/*.md", "docs/commands/*.md", *(page for pages in GROUPS.values() for page in pages)]
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types in the docstrings' words: "logs as of `read`"
autodoc_default_options = {"members": True}
autodoc_typehints = "none"
default_role = "code"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
smartquotes = False  # two hyphens begin an option
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 4
copybutton_prompt_text = r"\$ |> "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = f"lidarcli {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False


def navigation() -> str:
    """The groups as tables of contents, which the theme shows beside every page."""
    parts = ["```{toctree}\n:hidden:\n\ndocs/README\n```\n"]
    for caption, pages in GROUPS.items():
        entries = "\n".join(f"{name} <{page.removesuffix('.md')}>" for page, name in pages.items())
        parts.append(f"```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{entries}\n```\n")
    return "\n".join(parts)


def prepare(_app: Sphinx, name: str, source: list[str]) -> None:
    """Leave out badges; give the front page the navigation, and that of the commands their pages."""
    source[0] = COMMAND.sub(_linked, BADGE.sub("", source[0]).replace("](../README.md", "](../index.md"))
    if name == root_doc:
        source[0] += "\n\n" + navigation()
    if name in BELOW:
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n:glob:\n\n{BELOW[name]}\n```\n"


def _linked(match: re.Match[str]) -> str:
    """The help of a command, as a link to its page."""
    return f"[{match[0]}](/docs/commands/{match[1].replace(' ', '-')}.md)"


def described(_app: Sphinx, _kind: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Set what a name means below it: numpydoc takes the words beside a name for its type. Pages are links."""
    text = re.sub(r"^(\w+(?:, \w+)*) : ", r"\1\n    ", "\n".join(lines).replace("|", "\\|"), flags=re.MULTILINE)
    lines[:] = re.sub(r"docs/(\w+)\.md", r":doc:`\1`", text).split("\n")


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", prepare)
    app.connect("autodoc-process-docstring", described, priority=1)
    app.add_lexer("csv", TextLexer)
