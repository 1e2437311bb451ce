"""The viewer of the HTML report at work in a browser: details, address, zoom, saving, dark ground and paper."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.reports.browser import CHROMIUM, Page, browser
from tests.reports.runs import crossing, sweep, thing, write_run
from tests.waiting import wait_until

pytestmark = [pytest.mark.whole, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]

WORDS = "document.getElementById('words').textContent"
DETAILS = """Object.fromEntries(
  [...document.querySelectorAll('#details div')].map(pair => [...pair.children].map(one => one.textContent))
)"""
WAIT = "new Promise(done => setTimeout(() => done(location.hash), 400))"


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with browser() as chromium:
        yield chromium


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., Path]:
    """The report of runs made by hand."""
    from lidarcli.cli import run

    def call(**tables: Any) -> Path:
        write_run(tmp_path / "tables", **tables)
        assert run(["-q", "report", str(tmp_path / "tables"), "-o", str(tmp_path / "a.html"), "--overwrite"]) == 0
        return tmp_path / "a.html"

    return call


def awaited(page: Page, expression: str) -> Any:
    """The value of a promise."""
    return page.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)["result"]["value"]


def press(page: Page, key: str) -> None:
    page.evaluate(f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}'}}))")


def box_of(page: Page, name: str) -> Any:
    """Left, top, width and height of an element in the window."""
    box = f"document.getElementById('{name}').getBoundingClientRect().toJSON()"
    return [page.evaluate(box)[side] for side in ("left", "top", "width", "height")]


def pixel_of(page: Page, x: float, y: float) -> tuple[float, float]:
    """Where a point of the scene [m] is in the window, while all of the ground is shown."""
    box = box_of(page, "scene")
    # The ground is that of all boxes and the sensor, with 6 % of air.
    low_x, high_x, low_y, high_y = GROUND
    air = 0.06 * max(high_x - low_x, high_y - low_y)
    wide, high = box[2] - 44 - 8, box[3] - 18 - 34
    scale = min(wide / (high_x - low_x + 2 * air), high / (high_y - low_y + 2 * air))
    u = 44 + wide / 2 + (x - (low_x + high_x) / 2) * scale
    v = 18 + high / 2 - (y - (low_y + high_y) / 2) * scale
    return box[0] + u, box[1] + v


GROUND = (0.0, 4.1, -0.5, 0.7)
"""Least and greatest x and y of the boxes of `BOXES` and the sensor [m]."""
BOXES = [
    {"box_x": 2.0, "box_y": -0.25, "box_length": 0.5, "box_width": 0.5, "r_min": 1.75, "shape": "round"},
    {"box_x": 3.85, "box_y": 0.45, "box_length": 0.5, "box_width": 0.5, "r_min": 3.6, "thing": 0.75},
]


def two_boxes() -> dict[str, Any]:
    """Five sweeps of two boxes."""
    return {
        "sweeps": [sweep(k, 2) for k in range(5)],
        "objects": [thing(k, n + 1, box_yaw=0.0, **box, x=0.0, y=0.0) for k in range(5) for n, box in enumerate(BOXES)],
    }


def mouse(page: Page, kind: str, at: tuple[float, float], **other: Any) -> None:
    page.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **other)


def click(page: Page, at: tuple[float, float]) -> None:
    for kind in ("mousePressed", "mouseReleased"):
        mouse(page, kind, at, button="left", clickCount=1)


def test_details_on_hover_and_click(page: Page, made: Callable[..., Path]) -> None:
    page.open(made(**two_boxes()), 1280)
    page.evaluate("document.getElementById('viewer').scrollIntoView()")
    assert page.evaluate(DETAILS) == {}
    mouse(page, "mouseMoved", pixel_of(page, 2.0, -0.25))
    assert page.evaluate("document.getElementById('tip').hidden") is False
    assert page.evaluate("document.getElementById('tip').textContent").startswith("object1")
    mouse(page, "mouseMoved", pixel_of(page, 1.0, 0.3))
    assert page.evaluate("document.getElementById('tip').hidden") is True
    click(page, pixel_of(page, 3.85, 0.45))
    assert page.evaluate(DETAILS) == {
        "object": "2",
        "kind": "object",
        "shape": "prismatic",
        "size": "0.50 \u00d7 0.50 m",
        "distance": "3.60 m",
        "thing": "75 %",
    }
    # The chosen one stays chosen in the next sweep.
    press(page, "ArrowRight")
    assert page.evaluate(DETAILS)["object"] == "2"
    wait_until(lambda: page.evaluate("location.hash") == "#sweep=1&object=2")
    click(page, pixel_of(page, 1.0, 0.3))
    assert page.evaluate(DETAILS) == {}
    for number in ("1", "2", "1"):
        press(page, "n")
        assert page.evaluate(DETAILS)["object"] == number
    assert page.evaluate(DETAILS)["shape"] == "round"
    assert "thing" not in page.evaluate(DETAILS)
    press(page, "Escape")
    assert page.evaluate(DETAILS) == {}
    assert page.complaints == []


BOX = "document.querySelector('{}').getBoundingClientRect().toJSON()"


@pytest.mark.parametrize("height", [760, 900])
def test_the_viewer_is_whole_on_the_first_screen(page: Page, made: Callable[..., Path], height: int) -> None:
    page.open(made(**crossing()), 1280, height)
    viewer, cards = (page.evaluate(BOX.format(name)) for name in ("#viewer", ".cards"))
    assert 40 < viewer["top"] < 80
    assert viewer["bottom"] <= height
    assert cards["top"] > viewer["bottom"]
    for name in (".controls", "#timeline", "#scene", "#legend", ".keys"):
        found = page.evaluate(BOX.format(name))
        assert viewer["top"] <= found["top"] < found["bottom"] <= viewer["bottom"]
        assert found["right"] <= 1280
    # What is drawn has all the room that the words leave.
    assert page.evaluate(BOX.format("#scene"))["height"] > height - 330
    assert page.complaints == []


def test_details_of_a_track(page: Page, made: Callable[..., Path]) -> None:
    page.open(made(**crossing()), 1280)
    page.evaluate("location.hash = '#sweep=3&track=2'")
    wait_until(lambda: page.evaluate(DETAILS))
    found = page.evaluate(DETAILS)
    assert (found["kind"], found["track"], found["speed"]) == ("agent", "2", "1.00 m/s")
    page.evaluate("location.hash = '#sweep=9&track=2'")
    wait_until(lambda: page.evaluate(DETAILS) == {})
    assert "not seen" in page.evaluate("document.getElementById('hint').textContent")
    page.evaluate("location.hash = '#sweep=9&track=1'")
    wait_until(lambda: page.evaluate(DETAILS).get("label") == "pallet")


def test_the_address_of_a_sweep(page: Page, made: Callable[..., Path]) -> None:
    front, rear = ([sweep(k, k % 3, topic=topic) for k in range(20)] for topic in ("/front", "/rear & up"))
    out = made(sweeps=[*front, *rear])
    page.open(out, 800)
    assert page.evaluate("location.hash") == ""
    press(page, "PageDown")
    press(page, "ArrowRight")
    wait_until(lambda: page.evaluate("location.hash") == "#sweep=11&topic=/front")
    # An address works on load, and when it changes.
    page.evaluate("history.replaceState(null, '', '#sweep=7&topic=/rear%20%26%20up')")
    page.call("Page.reload")
    awaited(page, WAIT)
    wait_until(lambda: page.evaluate(WORDS).startswith("sweep 7, "))
    assert page.evaluate("document.getElementById('stream').selectedOptions[0].textContent") == "run /rear & up (laser)"
    page.evaluate("location.hash = '#sweep=3&topic=/front'")
    wait_until(lambda: page.evaluate(WORDS).startswith("sweep 3, "))
    assert page.evaluate("document.getElementById('stream').value") == "0"
    for odd in ("#sweep=", "#sweep=x&topic=/none", "#sweep=1e99&track=;", "#%", "#sweep=%zz"):
        page.evaluate(f"location.hash = '{odd}'")
        awaited(page, WAIT)
    assert page.evaluate(WORDS).startswith("sweep ")
    assert page.complaints == []


SCENE = "document.getElementById('scene').toDataURL()"


def test_zoom_and_pan(page: Page, made: Callable[..., Path]) -> None:
    page.open(made(**two_boxes()), 1280)
    page.evaluate("document.getElementById('viewer').scrollIntoView()")
    whole = page.evaluate(SCENE)
    at = pixel_of(page, 2.0, -0.25)
    # Who only scrolls past is not held up.
    before = page.evaluate("scrollY")
    mouse(page, "mouseWheel", at, deltaX=0, deltaY=40)
    awaited(page, WAIT)
    assert page.evaluate(SCENE) == whole
    page.evaluate(f"scrollTo(0, {before})")
    pictures = {whole}
    for act in (
        lambda: page.evaluate("document.getElementById('closer').click()"),
        lambda: mouse(page, "mouseWheel", at, deltaX=0, deltaY=-100, modifiers=2),
        lambda: press(page, "-"),
        lambda: drag(page, at, (at[0] + 60, at[1] + 20)),
    ):
        act()
        awaited(page, WAIT)
        pictures.add(page.evaluate(SCENE))
    assert len(pictures) == 5
    assert page.evaluate("document.getElementById('scene').style.touchAction") == "none"
    press(page, "0")
    assert page.evaluate(SCENE) == whole
    assert page.evaluate("document.getElementById('scene').style.touchAction") == "pan-y"
    assert page.complaints == []


def test_two_fingers_zoom(page: Page, made: Callable[..., Path]) -> None:
    page.open(made(**two_boxes()), 400)
    page.evaluate("document.getElementById('viewer').scrollIntoView()")
    left, top, width, height = box_of(page, "scene")
    x, y = left + width / 2, top + height / 2

    def touch(kind: str, *apart: float) -> None:
        points = [{"x": x + side * apart[0], "y": y, "id": k} for k, side in enumerate((-1, 1))] if apart else []
        page.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    try:
        whole = page.evaluate(SCENE)
        touch("touchStart", 30.0)
        for apart in (40.0, 50.0, 60.0):
            touch("touchMove", apart)
        touch("touchEnd")
        awaited(page, WAIT)
    finally:
        page.call("Emulation.setTouchEmulationEnabled", enabled=False)
    assert page.evaluate(SCENE) != whole
    assert page.evaluate("document.getElementById('scene').style.touchAction") == "none"
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    assert page.complaints == []


def drag(page: Page, at: tuple[float, float], to: tuple[float, float]) -> None:
    mouse(page, "mousePressed", at, button="left", clickCount=1)
    mouse(page, "mouseMoved", to, button="left", buttons=1)
    mouse(page, "mouseReleased", to, button="left", clickCount=1)


CATCH = """(() => {
  window.saved = null;
  HTMLAnchorElement.prototype.click = function () { window.savedAs = this.download; };
  const make = URL.createObjectURL.bind(URL);
  URL.createObjectURL = (blob) => { window.saved = blob; return make(blob); };
})()"""


def saved(page: Page, kind: str) -> bytes:
    """What the page would write; nothing is written."""
    page.evaluate(CATCH)
    page.evaluate(f"document.getElementById('save').value = '{kind}'")
    page.evaluate("document.getElementById('save').dispatchEvent(new Event('change'))")
    awaited(page, WAIT)
    return bytes(awaited(page, "saved.arrayBuffer().then(x => Array.from(new Uint8Array(x)))"))


def test_a_sweep_is_saved(page: Page, made: Callable[..., Path]) -> None:
    run = crossing()
    for row in run["objects"]:
        if row.get("label"):
            row["label"] = 'a, "b" <c>'
    page.open(made(**run), 1280)
    press(page, "ArrowRight")
    rows = list(csv.DictReader(io.StringIO(saved(page, "objects").decode())))
    assert page.evaluate("savedAs") == "run-scan-1-objects.csv"
    assert [row["object"] for row in rows] == ["1", "2", "3"]
    assert [row["set"] for row in rows] == ["O", "A", "A"]
    assert rows[0]["label"] == 'a, "b" <c>'
    assert [float(rows[1][name]) for name in ("box_x", "box_y", "box_length", "r_min")] == pytest.approx(
        [2.9, -0.4, 0.4, 2.0], abs=1e-3
    )
    assert (rows[1]["track"], float(rows[1]["vy"])) == ("2", 1.0)
    root = ET.fromstring(saved(page, "svg").decode())
    words = [text.text for text in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {'1 a, "b" <c>', "2", "x [m]", "y [m]", "run /scan, sweep 1, 0.10 s (22:13:20.1)"} <= set(words)
    assert saved(page, "png").startswith(b"\x89PNG")
    assert page.evaluate("savedAs") == "run-scan-1.png"
    assert page.evaluate("document.getElementById('save-beams').disabled") is True
    assert page.complaints == []


def test_beams_are_saved(page: Page, tmp_path: Path) -> None:
    import lidarcli
    from lidarcli.cli import run
    from tests.places import SAMPLES

    log = SAMPLES / "room.mcap"
    assert run(["-q", "detect", str(log), "-o", str(tmp_path), "--end", "1"]) == 0
    words = ["-q", "report", str(tmp_path), "--log", str(log), "-o", str(tmp_path / "a.html")]
    assert run(words) == 0
    page.open(tmp_path / "a.html", 1280)
    rows = list(csv.DictReader(io.StringIO(saved(page, "beams").decode())))
    (batch,) = lidarcli.read(log)
    assert len(rows) == 361
    assert [float(row["r"] or "nan") for row in rows] == pytest.approx(batch.ranges[0].tolist(), abs=1e-3, nan_ok=True)
    assert float(rows[0]["theta"]) == pytest.approx(-3.141593)
    # The beams on objects are those that the sweeps table counts.
    import pyarrow.parquet as pq

    count = pq.read_table(tmp_path / "room.sweeps.parquet")["object_beams"][0].as_py()
    assert sum(bool(row["object"]) for row in rows) == count
    assert page.complaints == []


GROUND_COLOUR = "getComputedStyle(document.body).backgroundColor"
INK = "getComputedStyle(document.querySelector('.charts h3')).color"


def test_dark_ground_and_paper(page: Page, made: Callable[..., Path]) -> None:
    out = made(**crossing())
    page.open(out, 1280)
    light = page.evaluate(GROUND_COLOUR), page.evaluate(INK), page.evaluate(SCENE)
    assert light[:2] == ("rgb(255, 255, 255)", "rgb(26, 26, 26)")
    try:
        page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        awaited(page, WAIT)
        dark = page.evaluate(GROUND_COLOUR), page.evaluate(INK), page.evaluate(SCENE)
        assert dark[:2] == ("rgb(22, 24, 27)", "rgb(232, 232, 232)")
        assert dark[2] != light[2]
        # What is saved is for paper.
        assert b'fill="#ffffff"' in saved(page, "svg")
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        assert page.evaluate(SCENE) == light[2]
        page.evaluate("window.dispatchEvent(new Event('afterprint'))")
        assert page.evaluate(SCENE) == dark[2]
        page.call("Emulation.setEmulatedMedia", media="print", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        assert page.evaluate(GROUND_COLOUR) == "rgb(255, 255, 255)"
        # Pictures keep their sides, whatever room paper leaves them, and are not drawn anew in the colours of the screen.
        sides = "['scene', 'timeline'].map(id => document.getElementById(id)).map(one => [one.width, one.height])"
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        before = page.evaluate(sides)
        page.call("Emulation.setDeviceMetricsOverride", width=703, height=1032, deviceScaleFactor=1, mobile=False)
        awaited(page, WAIT)
        assert page.evaluate(sides) == before
        shown = "(one => one.clientWidth / one.clientHeight)(document.getElementById('scene'))"
        assert page.evaluate(shown) == pytest.approx(before[0][0] / before[0][1], rel=0.01)
        page.evaluate("window.dispatchEvent(new Event('afterprint'))")
        exact = "getComputedStyle(document.querySelector('.legend i')).printColorAdjust"
        assert page.evaluate(exact) == "exact"
    finally:
        page.call("Emulation.setEmulatedMedia", media="", features=[])
    assert page.complaints == []


def test_the_legend_lists_what_occurs(page: Page, made: Callable[..., Path]) -> None:
    page.open(made(**two_boxes()), 1280)
    entries = "[...document.querySelectorAll('#legend span')].map(one => one.textContent)"
    assert page.evaluate(entries) == ["box: prismatic", "box: round"]
    # Without beams there are no curves, and the scene has their room.
    assert page.evaluate("document.getElementById('curves').offsetParent") is None
    assert page.evaluate("document.getElementById('scene').clientWidth") == 1240


def test_the_world_frame(page: Page, made: Callable[..., Path]) -> None:
    poses = [{"pose_x": 100.0 + k, "pose_y": 50.0, "pose_yaw": 0.1 * k} for k in range(6)]
    sweeps = [sweep(k, 1, **pose) for k, pose in enumerate(poses)]
    sweeps[4] = sweep(4, 1)
    objects = [thing(k, 1, world_x=103.0, world_y=51.0) for k in range(6)]
    page.open(made(sweeps=sweeps, objects=objects), 1280)
    choose = "const w = document.getElementById('world'); w.value = 'world'; w.dispatchEvent(new Event('change'))"
    page.evaluate(choose)
    words = [text.text for text in ET.fromstring(saved(page, "svg").decode()).iter() if text.text]
    assert {"100", "102", "104"} <= set(words)
    press(page, "End")
    press(page, "ArrowLeft")
    assert awaited(page, WAIT) == "#sweep=4&view=world"
    assert "no pose is known for this sweep" in saved(page, "svg").decode()
    # Where nothing tells of poses there is no world.
    page.open(made(**crossing()), 1280)
    assert page.evaluate("document.getElementById('world').hidden") is True
    page.evaluate("location.hash = '#sweep=2&view=world'")
    awaited(page, WAIT)
    assert page.evaluate(WORDS).startswith("sweep 2, ")
    assert page.complaints == []


def test_the_axis_is_time(page: Page, made: Callable[..., Path]) -> None:
    """Of ten sweeps in a second half are missing in the middle: the time line has their room, and steps over it."""
    tables = crossing()
    late = [{**row, "stamp": row["stamp"] + (row["sweep"] >= 5) * 1_000_000_000} for row in tables["sweeps"]]
    page.open(made(**{**tables, "sweeps": late}), 1280)
    assert page.evaluate(WORDS).startswith("sweep 0, 0.00 s (22:13:20.0), ")
    left, top, width, _ = box_of(page, "timeline")
    for share, shown in ((0.0, 0), (0.2, 4), (0.4, 4), (0.6, 5), (0.75, 5), (1.0, 9)):
        x = left + 8 + share * (width - 16)
        page.evaluate(
            f"document.getElementById('timeline').dispatchEvent(new PointerEvent('pointerdown', "
            f"{{clientX: {x}, clientY: {top + 10}, pointerId: 1}}))"
        )
        assert page.evaluate(WORDS).startswith(f"sweep {shown}, "), share
    press(page, "Home")
    for k in range(10):
        seconds = 0.1 * k + (k >= 5)
        assert page.evaluate(WORDS).startswith(
            f"sweep {k}, {seconds:.2f} s (22:13:2{int(seconds)}.{int(10 * seconds + 0.5) % 10}), "
        )
        assert float(page.evaluate("document.getElementById('slider').value")) == pytest.approx(seconds, abs=1e-6)
        press(page, "ArrowRight")
    page.evaluate("const s = document.getElementById('slider'); s.value = 0.6; s.dispatchEvent(new Event('input'))")
    assert page.evaluate(WORDS).startswith("sweep 4, 0.40 s ")
    row = "(canvas => [...canvas.getContext('2d').getImageData(0, 3, canvas.width, 1).data])"
    shaded = page.evaluate(f"{row}(document.getElementById('timeline'))")[3::4]
    assert (shaded[len(shaded) // 2], shaded[len(shaded) // 10]) == (255, 0)
    assert page.complaints == []
