"""The HTML report: one file, nothing from outside, nothing executed that a log brings; and a viewer that works."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.reports import html
from lidarcli.reports.columns import Run as RunRows
from lidarcli.reports.html import choose_sweeps, pack
from lidarcli.reports.report import Report
from lidarcli.reports.run import RunPart
from lidarcli.reports.summary import summarise
from lidarcli.reports.world import Raw
from tests.places import SAMPLES
from tests.reports.browser import CHROMIUM, Page, browser
from tests.reports.runs import array, crossing, run_of, sweep, thing, track, write_run
from tests.reports.test_world import driving
from tests.waiting import wait_until

Run = Callable[..., Any]
EVIL = "</script><script>document.title='owned'</script><img src=x onerror=alert(1)>"


class Elements(HTMLParser):
    """The elements of a page with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def data_of(page: str) -> Any:
    """The data of the viewer."""
    match = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return json.loads(match[1])


def ranges_of(raw: dict[str, Any]) -> np.ndarray[Any, Any]:
    """The codes of all ranges, from the steps between them."""
    found, last = [], 0
    low, high = array(raw["ranges"], np.uint8).reshape(2, -1).astype(int).tolist()
    for step in map(sum, zip(low, (256 * byte for byte in high), strict=True)):
        last = (last + (-(step + 1) // 2 if step % 2 else step // 2)) % 65_536
        found.append(last)
    return np.array(found)


@pytest.fixture
def room(lidarcli: Run, tmp_path: Path) -> Path:
    """The report of a sample with its raw sweeps."""
    log = SAMPLES / "room.mcap"
    assert lidarcli("detect", log, "-o", tmp_path, "--beams") == (0, "")
    checks = ("--check", "sweeps == 100", "--check", "objects < 5")
    words = ("report", tmp_path / "room.objects.parquet", "-o", tmp_path / "room.html", "--log", log, *checks)
    assert lidarcli(*words)[0] == 1
    return tmp_path / "room.html"


@pytest.mark.slow
def test_nothing_comes_from_outside(room: Path) -> None:
    page = room.read_text("utf-8")
    for tag, attributes in Elements(page).found:
        assert tag not in ("link", "iframe", "object", "base", "form"), tag
        for name, value in attributes.items():
            if name in ("src", "href", "xlink:href", "srcset", "data"):
                assert (value or "").startswith(("#", "data:")), (tag, name, value)
            assert not name.startswith("on"), (tag, name)
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert policy[1].startswith("default-src 'none';")


@pytest.mark.slow
def test_the_viewer_holds_what_the_log_holds(room: Path, lidarcli: Run) -> None:
    import lidarcli as package

    (batch,) = package.read(SAMPLES / "room.mcap")
    found = data_of(room.read_text("utf-8"))["streams"][0]
    raw = found["raw"]
    ranges = ranges_of(raw).reshape(100, 361)
    there = ranges != html.LOST
    assert (there == np.isfinite(batch.ranges)).all()
    assert ranges[there] * raw["scale"] == pytest.approx(batch.ranges[there], abs=raw["scale"])
    assert raw["scale"] == 0.001
    assert array(raw["angle_min"], np.float32)[0] == pytest.approx(-np.pi)
    without_log = room.with_name("beams.html")
    assert lidarcli("report", room.with_name("room.objects.parquet"), "-o", without_log) == (0, "")
    again = data_of(without_log.read_text("utf-8"))["streams"][0]["raw"]
    assert again["ranges"] == raw["ranges"]
    assert again["closure"] == raw["closure"]
    assert array(again["angle_increment"], np.float32) == pytest.approx(array(raw["angle_increment"], np.float32))


@pytest.mark.slow
def test_without_beams_the_boxes_alone_are_shown(lidarcli: Run, tmp_path: Path) -> None:
    tables = write_run(tmp_path, [sweep(k, 1) for k in range(3)], [thing(k, 1) for k in range(3)])
    assert lidarcli("report", tables, "-o", tmp_path / "a.html") == (0, "")
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "Only the objects' boxes are shown" in page
    found = data_of(page)["streams"][0]
    assert "raw" not in found
    assert array(found["box_x"], np.int16) * found["scale"] == pytest.approx([2.1] * 3, abs=1e-3)
    assert array(found["offsets"], np.int32).tolist() == [0, 1, 2, 3]


def test_a_log_that_belongs_to_no_table(lidarcli: Run, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_run(tmp_path, [sweep(0, log=name)], name=name)
    code, err = lidarcli("report", tmp_path, "-o", tmp_path / "a.html", "--log", SAMPLES / "room.mcap")
    assert (code, "none of the tables is of this log" in err) == (2, True)
    code, err = lidarcli("report", tmp_path, "-o", tmp_path / "a.html", "--log", tmp_path / "none.bag")
    assert (code, "no such file or folder" in err) == (3, True)


@pytest.mark.slow
def test_script_in_every_text_of_a_log_stays_text(lidarcli: Run, tmp_path: Path) -> None:
    evil = {"log": EVIL, "topic": f"/{EVIL}", "frame_id": f"{EVIL}$x$"}
    name = EVIL.replace("/", "_")[:100]
    rows = [sweep(k, 1, **evil) for k in range(4)]
    rows[2] |= {"objects": 3}
    named = {**evil, "label": EVIL}
    objects = [thing(k, 1, track=1, **named) for k in range(4)]
    tables = write_run(tmp_path, rows, objects, name, damage=[EVIL], tracks=[track(1, 0, 3, end=EVIL, **named)])
    for suffix in ("html", "md", "xml", "json", "txt"):
        code, err = lidarcli("report", tables, "--baseline", tables, "-o", tmp_path / f"r.{suffix}")
        assert (code, err) == (0, "")
    page = (tmp_path / "r.html").read_text("utf-8")
    elements = Elements(page).found
    assert [tag for tag, _ in elements].count("script") == 2
    assert "img" not in [tag for tag, _ in elements]
    assert "owned" in page
    assert "<script>document" not in page
    assert "<script" not in (tmp_path / "r.md").read_text("utf-8")
    assert "<script" not in (tmp_path / "r.xml").read_text("utf-8")
    if CHROMIUM:
        with browser() as chromium:
            chromium.open(tmp_path / "r.html", 800)
            assert chromium.evaluate("document.title").startswith("lidarcli report: ")
            assert chromium.evaluate("document.getElementById('words').textContent").startswith("sweep 0, ")
            assert chromium.complaints == []


def packed_of(run: RunRows) -> Any:
    """The one stream of a run as the viewer holds it."""
    summary = summarise(run)
    (found,) = pack(run, summary, choose_sweeps(run, summary), {})["streams"]
    return found


def test_the_viewer_holds_the_tracks() -> None:
    run = run_of(**crossing())
    found = packed_of(run)
    held = found["tracks"]
    track = array(held["track"], np.int32)
    assert track.tolist() == run.objects.integers("track").tolist()
    assert "pose" not in found
    person = track == 2
    assert array(held["vy"], np.int16)[person] * held["speed"] == pytest.approx(np.ones(16))
    # What stands has no velocity.
    assert not array(held["vx"], np.int16)[track == 1].any()
    # Where they were in each sweep, the two legs as one.
    paths, rows = found["paths"], run.trajectories
    assert rows is not None
    at = np.argsort(rows.integers("sweep"), kind="stable")
    assert array(paths["offsets"], np.int32).tolist() == [0, 2, 4, 6, 8, 10, 13, 16, 19, 21, 23]
    assert array(paths["track"], np.int32).tolist() == rows.integers("track")[at].tolist()
    assert array(paths["y"], np.float32) == pytest.approx(rows.numbers("y")[at])
    assert array(paths["vy"], np.int16)[1] * held["speed"] == pytest.approx(1.0)
    assert found["labels"] == ["pallet"]
    assert (array(found["label"], np.uint16) == np.where(track == 1, 0, html.LOST)).all()
    assert not {"tracks", "paths", "labels", "label"} & {*packed_of(run_of([sweep(0, 1)], [thing(0, 1)]))}


def test_the_viewer_knows_where_the_sensor_was() -> None:
    run = driving(upside_down=True, far=5e6)
    found = packed_of(run)
    pose = found["pose"]
    assert pose["side"] == -1
    assert pose["origin"] == [5e6, 0.0]
    assert array(pose["x"], np.float32) == pytest.approx(0.3 * np.arange(5))
    assert array(found["paths"]["x"], np.float32) == pytest.approx(np.full(5, 3.0))
    assert array(found["paths"]["seen"], np.uint8).tolist() == [1, 1, 0, 1, 1]


def test_long_logs_are_thinned_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [sweep(k, 1) for k in range(1000)]
    rows[777] |= {"objects": 9}
    run = run_of(rows, [thing(k, 1) for k in range(1000)])
    summary = summarise(run)
    assert choose_sweeps(run, summary).note == ""
    monkeypatch.setattr(html, "BUDGET", 24_000)
    choice = choose_sweeps(run, summary)
    (kept,) = choice.rows
    assert 90 < len(kept) < 110
    assert 777 in kept
    assert {0, 999} <= set(kept.tolist())
    assert choice.note == (
        f"To keep this file small the viewer holds {len(kept)} of 1,000 sweeps, evenly spaced, and all that stand out."
    )
    packed = pack(run, summary, choice, {})
    assert array(packed["streams"][0]["sweep"], np.int32).tolist() == kept.tolist()
    assert len(json.dumps(packed)) < 45_000


def long_page(sweeps: int, beams: int) -> str:
    """The page of a long log: beams that tremble before walls, and ten objects in each sweep."""
    rng = np.random.default_rng(1)
    run = run_of(
        [sweep(k, 10, beams=beams) for k in range(sweeps)],
        [thing(k, n + 1, width=rng.uniform(0, 1)) for k in range(sweeps) for n in range(10)],
    )
    walls = 6.0 + 3.0 * np.sin(np.linspace(0.0, 9.0, beams))
    raw = Raw(
        np.arange(sweeps),
        np.full(sweeps, -np.pi),
        np.full(sweeps, 2 * np.pi / beams),
        np.full(sweeps, 1, np.uint8),
        np.full(sweeps, beams),
        walls + 0.01 * rng.standard_normal((sweeps, beams)),
    )

    summary = summarise(run)
    packed = pack(run, summary, choose_sweeps(run, summary), {(0, "/scan"): raw})
    assert packed["streams"][0]["count"] == sweeps
    return html.render(Report((RunPart(summary),), page=html.Page({**packed, "note": ""})))


@pytest.mark.slow
def test_a_page_of_many_sweeps_is_small() -> None:
    assert len(long_page(1000, 361).encode()) < 1_000_000


@pytest.mark.whole
def test_a_page_holds_and_shows_5000_sweeps_of_1081_beams(page: Page, tmp_path: Path) -> None:
    text = long_page(5000, 1081)
    assert len(text) < 10_000_000
    (tmp_path / "long.html").write_text(text, "utf-8")
    page.open(tmp_path / "long.html", 1280)
    assert page.evaluate(WORDS).startswith("sweep 0, ")
    page.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'End'}))")
    assert page.evaluate(WORDS).startswith("sweep 4999, ")
    assert page.complaints == []


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    if CHROMIUM is None:
        pytest.skip("needs Chromium")
    with browser() as chromium:
        yield chromium


PICTURE = "['scene', 'range', 'difference'].map(id => document.getElementById(id).toDataURL())"
WORDS = "document.getElementById('words').textContent"


@pytest.mark.whole
def test_the_viewer_in_a_browser(page: Page, room: Path) -> None:
    for width in (1280, 400):
        page.open(room, width)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        first = page.evaluate(PICTURE)
        assert all(len(one) > 3000 for one in first)
        assert page.evaluate(WORDS).startswith("sweep 0, 0.00 s (22:13:20.0), 5 objects, threshold d_th ")
        page.evaluate("const s = document.getElementById('slider'); s.value = 6; s.dispatchEvent(new Event('input'))")
        assert page.evaluate(WORDS).startswith("sweep 60, 6.00 s (22:13:26.0), ")
        assert all(one != other for one, other in zip(first, page.evaluate(PICTURE), strict=True))
        for key, sweep_shown in (("ArrowRight", 61), ("PageUp", 51), ("End", 99), ("Home", 0), ("ArrowLeft", 0)):
            page.evaluate(f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}'}}))")
            assert page.evaluate(WORDS).startswith(f"sweep {sweep_shown}, "), key
        page.evaluate("document.querySelector('.jump[data-sweep=\"31\"]').click()")
        assert page.evaluate(WORDS).startswith("sweep 31, ")
        assert "most lost beams (1.4 %)" in page.evaluate(WORDS)
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []


@pytest.mark.whole
def test_play_runs_to_the_end(page: Page, room: Path) -> None:
    page.open(room, 1280)
    page.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'End'}))")
    page.evaluate("document.getElementById('back').click()")
    page.evaluate("document.getElementById('play').click()")
    assert page.evaluate("document.getElementById('play').textContent") == "Stop"
    wait_until(lambda: page.evaluate(WORDS).startswith("sweep 99, "))
    assert page.evaluate("document.getElementById('play').textContent") == "Play"
