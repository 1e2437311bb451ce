"""Colours and marks of all pictures: Okabe and Ito's, told apart by the colour-blind, and by their marks in print."""

from __future__ import annotations

from typing import Any

from lidarcli.choices import SET_WORDS

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    "#000000",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#F0E442",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
)
DARK, GREY, LIGHT = "#4D4D4D", "#8C8C8C", "#D9D9D9"
ALL = (BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE, DARK, GREY, LIGHT)

WALL = "#D0D0D0"
"""A wall is what things stand out from."""

SET_STYLES = {"S": (GREY, "o", 0.7), "O": (BLUE, "o", 1.0), "A": (VERMILION, "^", 1.3)}
"""Set (Def. 4) → colour, mark, share of the size of a dot."""
SET_LEGENDS = {name: words if name == "S" else f"beams on {words}" for name, words in SET_WORDS.items()}
"""Set (Def. 4) → how legends call its beams."""
SHAPE_COLOURS = {
    "prismatic": SKY,
    "round": ORANGE,
    "legged": GREEN,
    "irregular": PURPLE,
    "unknown": DARK,
    "wall": YELLOW,
}
TRACK_COLOURS = (ORANGE, SKY, GREEN, YELLOW, VERMILION, PURPLE, BLUE)
"""Of tracks, by their number."""
SHAPE_WORDS = {
    "prismatic": "prismatic object",
    "round": "round object",
    "legged": "legged object",
    "irregular": "irregular object",
    "unknown": "object, shape unknown",
    "wall": "wall",
}
"""Shape → how legends call what has it."""
VERTICES = {"start": (">", BLACK), "end": ("<", BLACK), "corner": ("s", VERMILION), "extremum": ("D", GREEN)}

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
