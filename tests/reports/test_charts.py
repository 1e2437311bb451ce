"""The charts of the HTML report: what is drawn, what is only told, and in which colours."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from lidarcli.palette import COLOURS, HEAT, page_style, themed
from lidarcli.reports.charts import charts, constants
from lidarcli.reports.compare import compare
from lidarcli.reports.figures import Density
from lidarcli.reports.report import Report
from lidarcli.reports.summary import summarise
from tests.reports.runs import crossing, run_of, sweep, thing


def report_of(**tables: Any) -> Report:
    return Report(summarise(run_of(**tables)))


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


def titles(report: Report) -> list[str]:
    return [chart.title for chart in charts(report)]


def test_what_is_constant_is_a_line_of_text() -> None:
    report = report_of(sweeps=[sweep(k, 1) for k in range(5)], objects=[thing(k, 1) for k in range(5)])
    assert {one.title: one.words for one in constants(report)} == {
        "Objects per sweep": "1 always",
        "Range of objects": "2 m always",
        "Width of objects": "0.4 m always",
        "Threshold d_th": "0.1 m always",
        "Noise σ of the ranges": "0.01 m always",
        "Objects by shape": "all 5 prismatic",
        "Objects by visibility": "all 5 full",
    }
    assert titles(report) == ["Beams", "Bearing of objects", "Where objects were, sensor frame"]


def test_what_varies_is_a_chart() -> None:
    report = report_of(**varied())
    assert constants(report) == []
    assert titles(report) == [
        "Objects over time",
        "Threshold over time",
        "Noise over time",
        "Beams",
        "Objects per sweep",
        "Range of objects",
        "Bearing of objects",
        "Width of objects",
        "Objects by shape",
        "Objects by visibility",
        "Where objects were, sensor frame",
    ]


def test_noise_that_is_about_the_same() -> None:
    rows = [sweep(k, k % 2, noise=0.010 + 0.0001 * (k % 3)) for k in range(30)]
    (words,) = [one.words for one in constants(report_of(sweeps=rows)) if one.name == "noise"]
    assert words == "0.01 m to 0.0102 m (5 % and 95 % of the sweeps)"


def test_a_comparison_keeps_its_charts() -> None:
    run = run_of([sweep(k, 1) for k in range(5)], [thing(k, 1) for k in range(5)])
    summary = summarise(run)
    report = Report(summary, compare(run, summary, run, summary))
    assert [one.name for one in constants(report)] == ["Objects by shape", "Objects by visibility"]
    assert "Width of objects" in titles(report)


def test_beams_are_two_bars_of_a_whole_each() -> None:
    (svg,) = [chart.svg for chart in charts(report_of(**crossing())) if chart.title == "Beams"]
    words = [re.sub("<[^>]*>", "", text) for text in re.findall(r"<text[^>]*>(.*?)</text>", svg, re.DOTALL)]
    shares = [float(match[1]) for text in words if (match := re.search(r"([\d.]+)%", text))]
    # Valid and no return; objects, agents and the rest: each once.
    assert len(shares) == 5
    assert sum(shares[:2]) == pytest.approx(100)
    assert sum(shares[2:]) == pytest.approx(100)


def test_colours_of_charts_are_those_of_the_page() -> None:
    found = [*charts(report_of(**crossing()))]
    known = page_style()
    for chart in found:
        names = re.findall(r"var\(--([a-z0-9-]+)\)", chart.svg)
        assert names, chart.title
        assert all(f"--{name}:" in known for name in names)
        # Nothing is left that stays light on dark ground.
        assert set(re.findall(r"(?:fill|stroke): (#[0-9a-f]{6})", chart.svg)) == set(), chart.title
    assert themed('<a style="fill: #0072B2"/><text>#0072b2</text>') == (
        '<a style="fill: var(--blue)"/><text>#0072b2</text>'
    )


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


def test_cells_that_are_too_small_to_see_are_put_together() -> None:
    from lidarcli.reports.charts import _coarse
    from lidarcli.reports.ground import Walls

    counts = np.arange(12).reshape(4, 3)
    found = Density("sensor", 0.0, 0.0, 0.1, counts)
    assert _coarse(found, None)[0] is not counts
    assert (_coarse(found, None)[0] == counts).all()
    far = Walls(0.1, np.array([0.0, 12.0]), np.array([0.0, 3.0]))
    sums, cell = _coarse(found, far)
    assert cell == pytest.approx(0.2)
    assert sums.tolist() == [[0 + 1 + 3 + 4, 2 + 5], [6 + 7 + 9 + 10, 8 + 11]]
    # Whatever another program has written.
    sums, _ = _coarse(found, Walls(1e9, np.array([0.0, 1e12]), np.zeros(2)))
    assert sums.tolist() == [[66]]
