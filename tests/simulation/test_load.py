"""Scene files: what they mean, and one clear line for whatever is wrong with them."""

from pathlib import Path

import numpy as np
import pytest

from lidarcli.errors import LidarcliError, OptionError, UnreadableError
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.route import Route, Waypoint
from lidarcli.simulation.scene import load_scene


@pytest.fixture
def load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def from_text(text):
        Path("scene.toml").write_text(text, encoding="utf-8")
        return load_scene("scene.toml")

    return from_text


def test_an_empty_file_is_the_default_sensor_in_the_void(load):
    scene = load("")
    assert (scene.name, scene.sweeps, scene.entities, scene.odometry) == ("scene", 100, (), None)
    assert (scene.sensor.beams, scene.sensor.range_min, scene.sensor.range_max) == (361, 0.1, 12.0)
    assert scene.sensor.angle_min == pytest.approx(-np.pi)
    assert scene.sensor.angle_increment == pytest.approx(np.radians(1))


@pytest.mark.parametrize(
    ("view", "first", "last"),
    [
        ("beams = 361", -180, 180),
        ("beams = 360\nfov = 360", -180, 179),
        ("beams = 271\nfov = 270", -135, 135),
        ("beams = 5\nangle_min = 0\nangle_max = 40", 0, 40),
        ("beams = 5\nangle_min = 0\nangle_max = 40\nclockwise = true", 40, 0),
        ("beams = 360\nfov = 360\nclockwise = true", 179, -180),
    ],
)
def test_views(load, view, first, last):
    bearings = np.degrees(load(f"[sensor]\n{view}").sensor.bearings)
    assert bearings[[0, -1]] == pytest.approx([first, last])


def test_entities_in_the_order_of_the_file(load):
    scene = load(
        """
        [[box]]
        x = 1
        y = 2
        length = 0.5
        width = 0.25
        yaw = 90
        [[wall]]
        points = [[0, 0], [2, 0], [2, 3]]
        closed = true
        [[person]]
        x = 0
        y = 0
        velocity = [0, 1.5]
        appears = 2
        [[ladder]]
        x = 3
        y = 3
        """
    )
    box, wall, person, ladder = scene.entities
    assert [e.kind for e in scene.entities] == ["box", "wall", "person", "ladder"]
    assert (box.x, box.y, box.length, box.width, box.yaw) == (1, 2, 0.5, 0.25, np.pi / 2)
    assert wall.wall
    assert (wall.segments + [wall.x, wall.y] * 2).tolist() == [[0, 0, 2, 0], [2, 0, 2, 3], [2, 3, 0, 0]]
    assert person.yaw == pytest.approx(np.pi / 2)
    assert (person.motion.stride, person.motion.cadence) == (0.5, 1.5)
    assert (person.motion.appears, person.motion.disappears) == (2, np.inf)
    assert len(ladder.segments) == 16


def test_a_robot_on_a_course(load):
    scene = load("[robot]\nx = 1\ny = -1\nsuper_ellipse = { a = 2, b = 1, exponent = 2 }\nspeed = 0.3\n[robot.odometry]")
    assert np.hypot(*((scene.path.points - [1, -1]) / [2, 1]).T) == pytest.approx(1)
    assert scene.odometry is not None
    assert (scene.odometry.topic, scene.odometry.frame_id, scene.odometry.tf) == ("/odom", "odom", True)


def test_routes_of_all_that_moves(load):
    scene = load(
        """
        [sensor]
        time_increment = 0.0002
        flicker = 0.2
        [robot.route]
        speed = 0.5
        loop = true
        waypoints = [[0, 0], [4, 0], { x = 4, y = 3, wait = 2, speed = 0.3 }]
        [robot.mount]
        x = 0.2
        yaw = 90
        told = false
        [robot.odometry]
        delay = 0.15
        [[person]]
        [person.route]
        speed = 1.2
        waypoints = [[0, 5], [3, 5]]
        [[box]]
        length = 1
        width = 0.5
        yaw_rate = 20
        [box.route]
        speed = 0.4
        acceleration = 1
        turn_rate = 10
        waypoints = [[0, 7], { x = 0, y = 9, corner = "stop" }, [2, 9]]
        [[chair]]
        route = { speed = 0.4, waypoints = [[5, 7], [5, 8]] }
        yaw = 90
        """
    )
    assert (scene.sensor.time_increment, scene.sensor.flicker) == (0.0002, 0.2)
    assert isinstance(scene.path, Route)
    assert scene.path.loop
    assert scene.path.waypoints == (Waypoint(0, 0, 0.5), Waypoint(4, 0, 0.5), Waypoint(4, 3, 0.3, wait=2))
    assert scene.mount.pose == pytest.approx((0.2, 0, np.pi / 2))
    assert not scene.mount.in_log
    assert scene.odometry is not None
    assert scene.odometry.delay == 0.15
    assert not scene.still
    person, box, chair = scene.entities
    start, end = np.array([0.0]), np.array([1000.0])
    assert person.poses(end)[0] == pytest.approx([3, 5, 0])
    assert person.feet(end) is not None
    assert box.poses(start)[0] == pytest.approx([0, 7, 0])
    assert box.poses(np.array([1.0]))[0, 2] == pytest.approx(np.radians(20))
    assert box.motion.route is not None
    assert box.motion.route.waypoints[1].corner == "stop"
    # Turned by 90 degrees against its way, which leads along +y.
    assert chair.poses(end)[0] == pytest.approx([5, 8, np.pi])


ROUTE = "speed = 1, waypoints = [[0, 0], [1, 1]]"
WRONG = [
    ("[[boxx]]", "the scene", "boxx"),
    ("scene = 3", "[scene]", ""),
    ("[[box]]\nx = 1", "[[box]] number 1", "length"),
    ("[[cylinder]]\nx=1\ny=1\nradius=1\n[[cylinder]]\nx=1\ny=1\nradius=-1", "[[cylinder]] number 2", "radius"),
    ("[[cylinder]]\nx='a'\ny=1\nradius=1", "[[cylinder]] number 1", "x"),
    ("[[wall]]\npoints = [[1, 2], [3]]", "[[wall]] number 1", "points"),
    (f"[[wall]]\npoints = [[0, 0], [{10**400}, 1]]", "[[wall]] number 1", "points"),
    ("[[wall]]\npoints = [" + "[0, 1], " * 12_001 + "]", "12,000 sides and circles", ""),
    ("[[ladder]]\nx=1\ny=1\nleg=0.3", "[[ladder]] number 1", "leg"),
    ("[[person]]\nx = 0\ny = 0\nvelocity = [1, -1e9]", "[[person]] number 1", "velocity"),
    ("[[person]]\nroute = { waypoints = [[0, 0], [1, 0]] }", "[[person]] number 1, route", "speed"),
    (f"[[person]]\nyaw = 3\nroute = {{ {ROUTE} }}", "[[person]] number 1", "yaw"),
    (f"[[box]]\nx = 1\nlength = 1\nwidth = 1\nroute = {{ {ROUTE} }}", "[[box]] number 1", "x"),
    ("[scene]\nsweeps = 10000001", "[scene]", "sweeps"),
    ("[sensor]\nbeams = 0", "[sensor]", "beams"),
    ("[sensor]\nlost_as = 'foo'", "[sensor]", "lost_as"),
    ("[sensor]\nfov = 90\nangle_min = 0", "[sensor]", "fov"),
    ("[sensor]\nangle_min = 10\nangle_max = 0", "[sensor]", "angle_max"),
    ("[sensor]\nrange_max = 0.05", "[sensor]", "range_max"),
    ("[sensor]\ntopic = ''", "[sensor]", "topic"),
    ("[sensor]\ntime_increment = 0.001", "[sensor]", "time_increment"),
    ("[sensor]\nflicker = 1", "[sensor]", "flicker"),
    (f"[robot]\nx = {10**400}", "[robot]", "x"),
    ("[robot]\nwaypoints = [[0, 0], [1, 0]]", "[robot]", "speed"),
    ("[robot]\nspeed = 1\nwaypoints = [[2, 3], [2, 3]]", "[robot]", "waypoints"),
    ("[robot]\nspeed=1\nsuper_ellipse = { a = 1, b = 1, n = 4 }", "[robot.super_ellipse]", "n"),
    (f"[robot]\nspeed = 1\nroute = {{ {ROUTE} }}", "[robot]", "speed"),
    ("[robot.route]\nspeed = 1\nwaypoints = [[0, 0], [1, 'a']]", "[robot.route.waypoints] number 2", "y"),
    (
        "[robot.route]\nspeed = 1\nwaypoints = [[0, 0], { x = 1, y = 1, weit = 2 }]",
        "[robot.route.waypoints] number 2",
        "weit",
    ),
    ("[robot.route]\nspeed = 1\nwaypoints = [[0, 0], { x = 1, y = 1, corner = '' }]", "[robot.route.waypoints]", "corner"),
    ("[robot.route]\nspeed = 1\nwaypoints = [[0, 0], [1, 1], [1, 1]]", "[robot.route]", "waypoints"),
    ("[robot.route]\nspeed = 1\nloop = true\nwaypoints = [[0, 0], [1, 1], [0, 0]]", "[robot.route]", "waypoints"),
]
"""Text of a scene → where it is wrong, and the key."""


@pytest.mark.parametrize(("text", "place", "key"), WRONG, ids=lambda text: text[:30])
def test_what_is_wrong_is_named_in_one_line(load, text, place, key):
    with pytest.raises(OptionError) as caught:
        load(text)
    message = str(caught.value)
    assert message.startswith(f"scene.toml: {place}")
    assert "\n" not in message
    assert not key or f"'{key}'" in message


def test_broken_files(load, tmp_path):
    with pytest.raises(UnreadableError, match=r"^scene\.toml: not valid TOML: .*line 1"):
        load("[scene\n")
    with pytest.raises(UnreadableError, match=r"^nowhere\.toml: cannot read the scene: No such file or directory$"):
        load_scene("nowhere.toml")
    with pytest.raises(UnreadableError, match=r"cannot read the scene: Is a directory$"):
        load_scene(tmp_path)
    Path("scene.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(UnreadableError, match=r"^scene\.toml: byte 8: not UTF-8 text; a scene is a TOML file$"):
        load_scene("scene.toml")
    assert issubclass(UnreadableError, LidarcliError)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a=" + "[" * 100_000, "line 1: more than 16 brackets are open"),
        ("\na=" + "{b=" * 100_000, "line 2: more than 16 brackets are open"),
        ("a=[\n" * 17, "line 17: more than 16 brackets are open"),
        (".".join("a" * 50_000) + "=1", "line 1: a key of more than 16 parts"),
        ("[" + " . ".join("a" * 50_000) + "]", "line 1: a key of more than 16 parts"),
        ("x=1\n" + ".".join(["'a'"] * 20_000) + "=1", "line 2: a key of more than 16 parts"),
        ("#" * 1_000_001, "larger than a scene may be (1,000,000 bytes)"),
        ("x = " + "9" * 5_000, "not valid TOML: Exceeds the limit"),
        ("x = " + '"' + '\\"' * 100_000, "not valid TOML: "),
    ],
    ids=lambda text: text[:20],
)
def test_what_a_parser_would_choke_on_is_refused_first(load, text, message):
    with pytest.raises(UnreadableError) as caught:
        load(text)
    assert str(caught.value).startswith(f"scene.toml: {message}")
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 3


def test_an_entity_can_swallow_beams(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text("[[box]]\nx = 2\ny = 0\nlength = 1\nwidth = 1\nlost = 0.5\n[[wall]]\npoints = [[3, -1], [3, 1]]\n")
    scene = load_scene(file)
    assert [entity.lost for entity in scene.entities if not entity.wall] == [0.5]
    assert [entity.lost for entity in scene.entities if entity.wall] == [0.0]
    raw, hit, entities = simulate_sweep_arrays(scene, 400, 0)
    box = next(k for k, entity in enumerate(entities) if not entity.wall)
    ahead = np.isfinite(raw.ranges[:, 180])
    assert 0.4 < ahead.mean() < 0.6
    assert (hit[:, 180][ahead] == box).all()


def test_an_entity_can_tell_its_intensity(tmp_path):
    """What tells none beside others returns 0; a scene that tells none has no intensities at all."""
    text = "[sensor]\nbeams = 37\nfov = 36\n[[box]]\nx = 2\ny = 0\nlength = 1\nwidth = 0.3\n{box}"
    text += "[[wall]]\npoints = [[3, -1], [3, 1]]\n"
    (tmp_path / "lit.toml").write_text(text.format(box="intensity = 812.5\n"))
    scene = load_scene(tmp_path / "lit.toml")
    assert [entity.intensity for entity in scene.entities] == [812.5, None]
    raw, entity, _ = simulate_sweep_arrays(scene, 2)
    assert {kind: set(raw.intensities[entity == number]) for kind, number in (("box", 0), ("wall", 1))} == {
        "box": {812.5},
        "wall": {0.0},
    }
    (tmp_path / "dark.toml").write_text(text.format(box=""))
    assert simulate_sweep_arrays(load_scene(tmp_path / "dark.toml"), 2)[0].intensities is None
    (tmp_path / "wrong.toml").write_text(text.format(box="intensity = -1\n"))
    with pytest.raises(OptionError, match="number 1: 'intensity' must be at least 0, not -1"):
        load_scene(tmp_path / "wrong.toml")
