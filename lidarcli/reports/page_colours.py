"""The colours of a page by their names: those for light ground and paper, and those for dark ground."""

from __future__ import annotations

import re

from lidarcli.reports import palette

COLOURS = {
    "ink": ("#1a1a1a", "#e8e8e8"),
    "quiet": ("#5c5c5c", "#a9adb3"),
    "line": ("#dcdcdc", "#3b3f45"),
    "paper": ("#ffffff", "#16181b"),
    "raised": ("#f6f6f6", "#25282c"),
    "pressed": ("#e9e9e9", "#33373c"),
    "edge": ("#8a8a8a", "#7a8088"),
    "bad": ("#b34700", "#ff9d5c"),
    "good": ("#00664b", "#4fd1a5"),
    "alarm": ("#fdf3ec", "#35261b"),
    "shade": ("#d3ebf8", "#1f3d51"),
    "bar-objects": ("#9ecae9", "#2f6d99"),
    "bar-agents": ("#eca77c", "#b0622c"),
    "blue": (palette.BLUE, "#4ba3e3"),
    "sky": (palette.SKY, "#8fd0f5"),
    "vermilion": (palette.VERMILION, "#ff8a3d"),
    "green": (palette.GREEN, "#2fc796"),
    "orange": (palette.ORANGE, "#f2b233"),
    "purple": (palette.PURPLE, "#e39bc4"),
    "yellow": (palette.YELLOW, "#f0e442"),
    "grey": (palette.GREY, "#8f949b"),
    "dark": (palette.DARK, "#c4c7cb"),
    "light": (palette.LIGHT, "#44484e"),
    "grid": (palette.STYLE["grid.color"], "#2c3035"),
    # From few to many: away from the ground, whichever it is.
    "heat-1": ("#cfe1f2", "#1d3a54"),
    "heat-2": ("#93c3df", "#25587f"),
    "heat-3": ("#4b97c9", "#3380ae"),
    "heat-4": ("#1864aa", "#6cb5d9"),
    "heat-5": ("#08306b", "#d6eefb"),
}
"""Name → colour on light and on dark ground; each has a contrast to its ground that can be seen."""
HEAT = tuple(light for name, (light, _) in COLOURS.items() if name.startswith("heat-"))
_NAMES = {light.lower(): name for name, (light, _) in COLOURS.items()} | {
    palette.BLACK: "ink",
    "#ffffff": "paper",
}


def style() -> str:
    """The colours as properties of the page; on paper they are light, whatever the screen is. `.paper` always is."""
    light, dark = (
        "".join(f" --{name}: {pair[k]};" for name, pair in COLOURS.items()) + _shapes(k) for k in (0, 1)
    )
    return (
        f":root, .paper {{ color-scheme: light;{light} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ color-scheme: dark;{dark} }} }}"
    )


def _shapes(ground: int) -> str:
    found = ""
    for name, colour in palette.SHAPE_COLOURS.items():
        known = _NAMES.get(colour.lower())
        found += f" --shape-{name}: {COLOURS[known][ground] if known else colour};"
    return found


def themed(svg: str) -> str:
    """A drawing whose colours are those of the page around it.

    >>> themed('<path style="fill: #0072b2; stroke: #123456"/>')
    '<path style="fill: var(--blue); stroke: #123456"/>'
    """

    def named(match: re.Match[str]) -> str:
        name = _NAMES.get(match[0].lower())
        return f"var(--{name})" if name else match[0]

    return re.sub(r'style="[^"]*"', lambda found: re.sub(r"#[0-9a-fA-F]{6}", named, found[0]), svg)
