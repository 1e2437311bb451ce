"""The charts of the HTML report: what is drawn, what is only told, and in which colours."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidarcli.display.palette import COLOURS, HEAT, page_style
from lidarcli.reports.figures import Density
from lidarcli.reports.html import charts
from lidarcli.reports.run import RunPart
from lidarcli.reports.summary import summarise
from lidarcli.reports.world import Walls
from tests.reports.runs import run_of, sweep, thing


def report_of(**tables: Any) -> RunPart:
    return RunPart(summarise(run_of(**tables)))


def varied() -> dict[str, Any]:
    """Ten sweeps of which nothing is constant."""
    shapes = ("prismatic", "round")
    return {
        "sweeps": [sweep(k, 1 + k % 2, d_th=0.1 + 0.01 * k, noise=0.01 + 0.002 * k) for k in range(10)],
        "objects": [
            thing(k, n + 1, shape=shapes[n], visibility=("full", "cut")[n], r_min=1.0 + 0.3 * k, width=0.1 * k)
            for k in range(10)
            for n in range(1 + k % 2)
        ],
    }


def titles(report: RunPart) -> list[str]:
    return [chart.title for chart in charts(report, {})]


def test_charts_of_a_run() -> None:
    report = report_of(**varied())
    assert titles(report) == [
        "Objects over time",
        "Threshold over time",
        "Noise over time",
        "Objects per sweep",
        "Range of objects",
        "Bearing of objects",
        "Width of objects",
        "Where objects were, sensor frame",
    ]


def test_what_a_chart_holds() -> None:
    """Its values are those of the figures, its words tell them, and its colours are those of the page."""
    report = report_of(**varied())
    found = {chart.title: chart for chart in charts(report, {})}
    over_time = found["Objects over time"]
    assert over_time.words == "Objects over time: 1.5 on average, 1 to 2"
    assert [key.words for key in over_time.keys] == ["least to most", "mean"]
    band, mean = over_time.values["series"]
    assert mean["y"] == [1, 2] * 5
    assert (band["low"], band["y"]) == (mean["y"], mean["y"])
    assert sum(found["Width of objects"].values["series"][0]["y"]) == 15
    known = page_style()
    for chart in found.values():
        colours = {key.colour for key in chart.keys} | {one["colour"] for one in chart.values.get("series", ())}
        assert all(f"--{name}:" in known for name in colours)


def test_where_objects_were() -> None:
    report = report_of(**varied())
    walls = Walls(0.1, np.array([-2.0, 3.0]), np.array([1.0, 1.0]))
    (chart,) = [one for one in charts(report, {"sensor": walls}) if one.aspect]
    assert chart.words.startswith("Where objects were, sensor frame: 15 objects in ")
    assert chart.values["limits"] == pytest.approx([-2.05, 0.0, 3.05, 1.05])
    assert chart.keys[-1].words == "walls and rest"


def luminance(colour: str) -> float:
    """By WCAG 2."""
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("ground", [0, 1])
def test_colours_can_be_read(ground: int) -> None:
    """Words have a contrast of 4.5, marks of 2 (those of Okabe and Ito on white have no more)."""
    shown = {name: pair[ground] for name, pair in COLOURS.items()}
    for name in ("ink", "quiet", "bad", "good"):
        assert contrast(shown[name], shown["paper"]) >= 4.5, name
        assert contrast(shown[name], shown["alarm"]) >= 4.5, name
    for name in ("blue", "sky", "vermilion", "green", "orange", "purple", "grey", "dark"):
        assert contrast(shown[name], shown["paper"]) >= 2, name
    # Few are near the ground, many away from it, on both.
    steps = [contrast(shown[f"heat-{k + 1}"], shown["paper"]) for k in range(len(HEAT))]
    assert steps == sorted(steps)
    assert steps[0] >= 1.2
    assert steps[-1] >= 10


@pytest.mark.parametrize(("reach", "cell", "sums"), [(0.0, 0.1, 12), (12.0, 0.2, 4), (1e12, None, 1)])
def test_cells_that_are_too_small_to_see_are_put_together(reach: float, cell: float | None, sums: int) -> None:
    """Whatever another program has written."""
    report = report_of(**varied())
    density = Density("sensor", 0.0, 0.0, 0.1, np.arange(1, 13).reshape(4, 3))
    report = replace(report, summary=replace(report.summary, densities=(density,)))
    far = {"sensor": Walls(0.1, np.array([0.0, reach]), np.array([0.0, 0.0]))} if reach else {}
    (chart,) = [one for one in charts(report, far) if one.aspect]
    assert len(chart.values["level"]) == sums
    assert cell is None or chart.values["cell"] == pytest.approx(cell)
