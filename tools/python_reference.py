"""The reference part of docs/python.md, from signatures and docstrings; what stands above its mark is written by hand."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import lidarcli
from lidarcli import options
from lidarcli.option_forms import options_of, python_words
from lidarcli.pipeline.api.options import keyword_types
from tools.reference import as_page, as_table

PAGE = Path(__file__).parent.parent / "docs" / "python.md"
MARK = "<!-- Below this line written by `make docs` from the docstrings; a test fails when it is stale. -->"
FUNCTIONS: dict[str, Any] = {
    "read": options.Reading,
    "detect": options.Detecting,
    "track": options.Tracking,
    "tables": options.Tabling,
    "zones": options.Zoning,
    "diff": options.Diffing,
    "poses": options.Reading,
    "background": options.Learning,
    "map": options.Mapping,
    "info": options.Inspecting,
    "report": options.Reporting,
    "plot": options.Plotting,
    "clean": options.Cleaning,
    "overlay": options.Overlaying,
    "export": options.Exporting,
    "simulate": options.Simulating,
}
GROUPS: dict[str, Any] = {
    "Sweeps to read": options.Topics,
    "Source of the poses": options.Poses,
    "Delay of the poses": options.Delay,
    "Ranges and geometry": options.Ranges,
    "Objects": options.Objects,
    "Comparison with a background": options.Comparing,
}
"""Keywords that several functions share, under the title that they are listed by."""
CLASSES = (
    "SweepBatch",
    "SweepPoses",
    "Background",
    "Occupancy",
    "TrackTables",
    "Tables",
    "ZoneTables",
    "Difference",
    "RunReport",
    "Simulated",
    "Parameters",
)
ERRORS = ("LidarcliError", "OptionError", "UnreadableError", "NoScanError", "OutputError")
OTHERS = ("read_catalogue", "Catalogue", "Status", "formalism")


def python_page() -> str:
    """docs/python.md with today's reference."""
    guide, _, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    lines = [guide.rstrip(), "", MARK, "", "## Functions", ""]
    for name, told in FUNCTIONS.items():
        lines += _function(name, told)
    lines += ["## Keywords that functions share", ""]
    for title, group in GROUPS.items():
        lines += [f"### {title}", "", inspect.cleandoc(group.__doc__), "", *_keywords(group, {*options_of(group)})]
    lines += ["## Classes", ""]
    for name in CLASSES:
        lines += _class(getattr(lidarcli, name))
    lines += ["## Errors", "", "All of them are a `LidarcliError`, and end the command line with the exit code.", ""]
    lines += as_table(("error", "exit code", "meaning"), map(_error, ERRORS))
    lines += ["## What else there is", "", *as_table(("name", "what it is"), map(_other, OTHERS))]
    return as_page(lines)


def _function(name: str, told: Any) -> list[str]:
    function = getattr(lidarcli, name)
    signature = inspect.signature(function)
    words, sections = _parsed(inspect.getdoc(function) or "")
    own = [one for one in signature.parameters.values() if one.name not in options_of(told)]
    known = options_of(told).keys()
    shared = {title: group for title, group in GROUPS.items() if options_of(group).keys() <= known}
    rest = {*known} - {key for group in shared.values() for key in options_of(group)}
    heads = [one.name if one.default is one.empty else f"{one.name}={one.default!r}" for one in own]
    lines = [f"### {name}", "", f"```python\nlidarcli.{name}({', '.join(heads)}, **keywords)\n```", "", words, ""]
    meanings = dict(_items(sections["Parameters"]))
    lines += as_table(("parameter", "meaning"), ((f"`{one.name}`", meanings[one.name]) for one in own))
    lines += _keywords(told, rest)
    if shared:
        links = (f"[{title.lower()}](#{title.lower().replace(' ', '-')})" for title in shared)
        lines += [f"More keywords: {', '.join(links)}.", ""]
    kind, _, what = sections["Returns"].partition("\n")
    lines += [f"Returns {kind}: {_joined(what)}", ""]
    return lines


def _keywords(group: Any, names: set[str]) -> list[str]:
    types = keyword_types(group)
    rows = (
        (f"`{name}`", f"`{option.default!r}`", f"`{_type(types[name])}`", python_words(name, option))
        for name, option in options_of(group).items()
        if name in names
    )
    return as_table(("keyword", "default", "type", "meaning"), rows) if names else []


def _class(kind: Any) -> list[str]:
    words, sections = _parsed(inspect.cleandoc(kind.__doc__))
    lines = [f"### {kind.__name__}", "", words, ""]
    attributes = [(f"`{name}`", text) for name, text in _items(sections.get("Attributes", ""))]
    lines += as_table(("attribute", "what it is"), iter(attributes)) if attributes else []
    methods = [(f"`{name}`", text) for name, text in _methods(kind, {name.strip("`") for name, _ in attributes})]
    return lines + (as_table(("property or method", "what it is"), iter(methods)) if methods else [])


def _methods(kind: Any, told: set[str]) -> Iterator[tuple[str, str]]:
    for name, value in vars(kind).items():
        words = (inspect.getdoc(value) or "").split("\n\n")[0].replace("\n", " ")
        if name.startswith("_") or name in told or not words:
            continue
        if isinstance(value, property):
            yield name, words
        elif isinstance(value, Callable | staticmethod):  # type: ignore[arg-type]
            yield f"{name}({', '.join(_arguments(getattr(kind, name)))})", words


def _arguments(function: Any) -> Iterator[str]:
    for one in inspect.signature(function).parameters.values():
        if one.name != "self":
            yield f"**{one.name}" if one.kind is one.VAR_KEYWORD else one.name


def _error(name: str) -> tuple[str, str, str]:
    kind = getattr(lidarcli, name)
    return f"`{name}`", str(kind.exit_code), _joined(inspect.getdoc(kind) or "")


def _other(name: str) -> tuple[str, str]:
    return f"`{name}`", (inspect.getdoc(getattr(lidarcli, name)) or "").split("\n\n")[0].replace("\n", " ")


def _parsed(text: str) -> tuple[str, dict[str, str]]:
    """What a docstring begins with, and its sections by their titles."""
    parts = re.split(r"^(\w+)\n-+\n", text, flags=re.MULTILINE)
    return parts[0].strip(), dict(zip(parts[1::2], (part.strip() for part in parts[2::2]), strict=True))


def _items(section: str) -> Iterator[tuple[str, str]]:
    for item in re.split(r"\n(?! )", section):
        name, mark, text = item.partition(" : ")
        if mark:
            yield name, _joined(text)


def _joined(text: str) -> str:
    return " ".join(text.split())


def _type(kind: Any) -> str:
    """A type without the places of its parts."""
    words = inspect.formatannotation(kind)
    words = re.sub(r"\b(?:[a-z_]\w*\.)+(?=[A-Z])", "", words)
    words = re.sub(r"^Optional\[(.*)\]$", r"\1 | None", words)
    return re.sub(r"Union\[(.*), NoneType\]", lambda found: f"{found[1].replace('], ', '] | ')} | None", words)
