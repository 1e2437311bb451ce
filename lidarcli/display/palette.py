"""Colours and marks of all pictures, and the colours of a page on light and on dark ground.

The colours are Okabe and Ito's, which the colour-blind can distinguish; in print their marks differ.
"""

from __future__ import annotations

import re
from typing import Any

from lidarcli.options.choices import SET_WORDS

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
DARK, GREY, LIGHT = "#4D4D4D", "#8C8C8C", "#D9D9D9"
ALL = (BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE, DARK, GREY, LIGHT)

WALL = "#D0D0D0"
"""Pale, so that objects are conspicuous in front of a wall."""

SET_STYLES = {"S": (GREY, "o", 0.7), "O": (BLUE, "o", 1.0), "A": (VERMILION, "^", 1.3)}
"""Set (Def. 4) → colour, mark, share of the size of a dot."""
SET_LEGENDS = {name: words if name == "S" else f"beams on {words}" for name, words in SET_WORDS.items()}
"""Set (Def. 4) → how legends call its beams."""
SHAPE_COLOURS = {"prismatic": SKY, "round": ORANGE, "legged": GREEN, "irregular": PURPLE, "unknown": DARK, "wall": YELLOW}
SHAPE_DOTS = {"irregular": (0.0, (1.2, 0.7))}
"""Shape → dots of its outline: in print its colour is as grey as that of another box."""
SHAPE_WORDS = {name: f"{name} object" for name in SHAPE_COLOURS} | {"unknown": "object, shape unknown", "wall": "wall"}
"""Shape → how legends call what has it."""
VERTICES = {"start": (">", BLACK), "end": ("<", BLACK), "corner": ("s", VERMILION), "extremum": ("D", GREEN)}

ZONE_COLOURS = {"stop": VERMILION, "approach": BLUE, "slowdown": YELLOW, "limit": ORANGE, "none": PURPLE}
"""Action of a zone, the worst first → its colour; `none` is that of zones without an action."""

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.0,
    "figure.dpi": 200,
    "savefig.dpi": 200,
    "svg.hashsalt": "lidarcli",
    "pdf.fonttype": 42,
    "path.simplify": False,
}


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
    "blue": (BLUE, "#4ba3e3"),
    "sky": (SKY, "#8fd0f5"),
    "vermilion": (VERMILION, "#ff8a3d"),
    "green": (GREEN, "#2fc796"),
    "orange": (ORANGE, "#f2b233"),
    "purple": (PURPLE, "#e39bc4"),
    "yellow": (YELLOW, "#f0e442"),
    "grey": (GREY, "#8f949b"),
    "dark": (DARK, "#c4c7cb"),
    "light": (LIGHT, "#44484e"),
    "grid": (STYLE["grid.color"], "#2c3035"),
    # From few to many: away from the ground, whichever it is.
    "heat-1": ("#cfe1f2", "#1d3a54"),
    "heat-2": ("#93c3df", "#25587f"),
    "heat-3": ("#4b97c9", "#3380ae"),
    "heat-4": ("#1864aa", "#6cb5d9"),
    "heat-5": ("#08306b", "#d6eefb"),
}
"""Name → colour on light and on dark ground; each has a visible contrast to its ground."""
HEAT = tuple(light for name, (light, _) in COLOURS.items() if name.startswith("heat-"))
_NAMES = {light.lower(): name for name, (light, _) in COLOURS.items()} | {BLACK: "ink", "#ffffff": "paper"}


def on_dark(colour: str) -> str:
    """Return the colour that takes the place of another on dark ground.

    >>> on_dark("#009E73"), on_dark("#123456")
    ('#2fc796', '#123456')
    """
    known = _NAMES.get(colour.lower())
    return COLOURS[known][1] if known else colour


def page_style() -> str:
    """Return the colours as CSS properties; on paper, and in `.paper`, they are those for light ground."""
    named = dict(COLOURS)
    for kind, colours in (("shape", SHAPE_COLOURS), ("zone", ZONE_COLOURS)):
        named |= {f"{kind}-{name}": (colour, on_dark(colour)) for name, colour in colours.items()}
    light, dark = ("".join(f" --{name}: {pair[k]};" for name, pair in named.items()) for k in (0, 1))
    return (
        f":root, .paper {{ color-scheme: light;{light} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ color-scheme: dark;{dark} }} }}"
    )


def themed(svg: str) -> str:
    """Return a drawing whose colours are those of the page around it.

    >>> themed('<path style="fill: #0072b2; stroke: #123456"/>')
    '<path style="fill: var(--blue); stroke: #123456"/>'
    """

    def named(match: re.Match[str]) -> str:
        name = _NAMES.get(match[0].lower())
        return f"var(--{name})" if name else match[0]

    return re.sub(r'style="[^"]*"', lambda found: re.sub(r"#[0-9a-fA-F]{6}", named, found[0]), svg)
