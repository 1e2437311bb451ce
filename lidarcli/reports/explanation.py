"""What happened at a time, on one page or picture: the answer, facts, a film, distance and speed."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from lidarcli.errors import OptionError
from lidarcli.options.choices import AS_IT_COMES
from lidarcli.reports.columns import Origin
from lidarcli.reports.document import PAGE, Card, Code, Film, NamedValues, Notes, ReportPart, Section, TimePlot, table_of
from lidarcli.reports.drawing import (
    Frame,
    Mark,
    Panel,
    draw_legend,
    draw_panel,
    draw_title,
    entries_of,
    file_bytes,
    fit_height,
    joined,
    new_figure,
    project_style,
)
from lidarcli.reports.picture import animate, frames
from lidarcli.reports.scene import Limits, Picture, limits_of, scene
from lidarcli.reports.zones import ZONE_WORDS

WIDTH = 6.4
"""Width of the picture [inch]."""
CURVE = 1.2
"""Height of a curve [inch]."""
AIR = 1.0
"""Room around the sensor, the zones and what is marked [m]."""
SHADES = 48
"""Colours of an image of the film: enough for its lines and letters."""


@dataclass(frozen=True, slots=True)
class Explanation(ReportPart):
    """What happened around a time of a log. Times are in seconds since the first sweep of the log's zones."""

    log: str
    moment: str
    """The time in words."""
    answer: tuple[str, ...]
    """Sentences, the first of which says it all."""
    key: tuple[Card, ...]
    facts: tuple[tuple[str, str], ...]
    courses: TimePlot
    pictures: tuple[Picture, ...]
    seconds: tuple[float, ...]
    """Time of each picture [s]."""
    stamps: tuple[str, ...]
    """The same in words."""
    cells: Mapping[str, Sequence[str]]
    """Heading → cells of the table of numbers."""
    commands: tuple[str, ...]
    """Commands that show more of it."""
    sources: tuple[Origin, ...] = ()
    figures: Mapping[str, float | None] = field(default_factory=dict)
    schema = "lidarcli.explanation/1"
    words = ZONE_WORDS

    @property
    def title(self) -> str:
        """Log and time."""
        return f"{self.log} at {self.moment}"

    @property
    def lines(self) -> list[str]:
        """The answer."""
        return [*self.answer]

    @property
    def at(self) -> int:
        """Number of the picture that is nearest to the time."""
        return int(np.abs(np.array(self.seconds) - self.courses.at).argmin()) if self.seconds else 0

    def cards(self) -> list[Card]:
        """Return the key figures."""
        return [*self.key]

    def sections(self) -> dict[str, Section]:
        """Return the sections by name."""
        found = {"answer": Section("What happened", [Notes([(line,) for line in self.answer])])}
        if self.pictures:
            film = Film(self.images(), self.stamps, self.seconds, self.at)
            found["film"] = Section("Step by step", [film], (PAGE,))
        found["courses"] = Section("Distance and speed", [self.courses], (PAGE,))
        found["facts"] = Section("What the log says", [NamedValues(self.facts)])
        found["numbers"] = Section("Second by second", [table_of(self.cells)])
        found["again"] = Section("To see more", [Notes([(Code(line),) for line in self.commands])])
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return answer and facts, for JSON."""
        return {"moment": self.moment, "answer": [*self.answer], "facts": dict(self.facts)}

    def limits(self) -> Limits:
        """Return what the scenes show: the sensor, the zones, and what is marked; no more than there are beams."""
        every = limits_of(self.pictures)
        points = [np.zeros((1, 2))]
        for one in self.pictures:
            points += [zone.outline for zone in one.areas]
            points += [np.array([path.mark]) for path in one.paths if path.zone or path.number == one.marked]
        low, high = np.concatenate(points).min(axis=0) - AIR, np.concatenate(points).max(axis=0) + AIR
        # Neither side is more than twice as long as the other.
        short = np.maximum(0.5 * (high - low).max() - (high - low), 0.0) * 0.5
        low, high = low - short, high + short
        x, y = ((max(low[k], side[0]), min(high[k], side[1])) for k, side in enumerate((every.x, every.y)))
        return every._replace(x=(float(x[0]), float(x[1])), y=(float(y[0]), float(y[1])))

    def images(self) -> list[str]:
        """Return the pictures as PNG of a page."""
        found = []
        for pixels in frames(self.pictures, "scene", AS_IT_COMES, limits=self.limits()):
            out = io.BytesIO()
            Image.fromarray(pixels).quantize(SHADES).save(out, "PNG", optimize=True)
            found.append("data:image/png;base64," + base64.b64encode(out.getvalue()).decode())
        return found

    def png(self) -> bytes:
        """Return the answer, the scene at that time, distance and speed as a PNG."""
        with project_style():
            figure = new_figure(WIDTH)
            names = [*self.courses.courses]
            shown = self.pictures[self.at : self.at + 1]
            grid = figure.add_gridspec(len(shown) + len(names), 1)
            axes = [figure.add_subplot(grid[row, 0]) for row in range(len(shown) + len(names))]
            limits = self.limits() if shown else None
            for own, picture in zip(axes, shown, strict=False):
                draw_panel(own, scene(picture, limits, 0.8 * WIDTH))
            draw_courses(axes[len(shown) :], self.courses)
            words = [self.title, *self.answer]
            if shown and abs(self.seconds[self.at] - self.courses.at) > 0.5:
                words.append(f"The sweep below is that of {self.stamps[self.at]}.")
            draw_title(figure, [part for line in words for part in wrap(line, 110)])
            draw_legend(figure, entries_of(axes), "outside lower left")
            aspect = 1.0 if limits is None else limits.aspect
            fit_height(figure, axes, [*([0.0] * len(shown)), *([CURVE] * len(names))], aspect)
            return file_bytes(figure, ".png")

    def write_film(self, path: Path) -> None:
        """Write the film as a GIF or MP4, in which a second is a second."""
        if not self.pictures:
            raise OptionError(f"{path.suffix}: no sweep within ten seconds of {self.moment} to show: give .html or .png")
        steps = np.diff(self.seconds)
        fps = float(np.clip(1.0 / np.median(steps), 1.0, 25.0)) if len(steps) else 1.0
        animate(self.pictures, "scene", path, replace(AS_IT_COMES, fps=fps), limits=self.limits())


def courses_figure(courses: TimePlot) -> Figure:
    """Return distance and speed over time, for a page."""
    figure = new_figure(7.0)
    grid = figure.add_gridspec(len(courses.courses), 1)
    axes = [figure.add_subplot(grid[row, 0]) for row in range(len(courses.courses))]
    draw_courses(axes, courses)
    draw_legend(figure, entries_of(axes), "outside lower left")
    fit_height(figure, axes, [1.5] * len(axes), 1.0)
    return figure


def draw_courses(axes: Sequence[Axes], courses: TimePlot) -> None:
    """Draw quantities over time, one kind on each of the axes; what went on meanwhile is shaded."""
    every = [one for some in courses.courses.values() for one in some]
    ends = [courses.at, *(float(edge) for one in every for edge in one.seconds[[0, -1]])]
    for k, (own, (words, some)) in enumerate(zip(axes, courses.courses.items(), strict=True)):
        known = [0.0, *(float(value) for one in some for value in one.values[np.isfinite(one.values)])]
        low, high = min(known), max(max(known), min(known) + 0.1)
        low, high = low - 0.08 * (high - low) * (low < 0.0), high + 0.08 * (high - low)
        marks = []
        for name, begin, end, colour in courses.stretches:
            corners = np.array([[begin, low], [end, low], [end, high], [begin, high], [begin, low]])
            style = {"color": colour, "alpha": 0.22, "lw": 0, "zorder": 1}
            marks.append(Mark(joined([corners]), style, name, area=True))
        line = {"color": "black", "lw": 0.8, "ls": (0, (3.0, 2.0)), "zorder": 4}
        marks.append(Mark(np.array([[courses.at, low], [courses.at, high]]), line))
        for one in some:
            style = {"color": one.colour, "lw": 1.2, "zorder": 5}
            marks.append(Mark(np.column_stack([one.seconds, one.values]), style, one.name))
        below = "time [s]" if k == len(axes) - 1 else ""
        draw_panel(own, Panel(Frame((min(ends), max(ends)), (low, high), (below, words)), marks))
