"""Scenes for `simulate`: mutated ones, and TOML made to harm."""

from __future__ import annotations

from tools.fuzz.commands import judge_commands
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words

SCENE = """[scene]
name = "room"
sweeps = 3

[sensor]
beams = 31
angle_min = -180.0
angle_max = 180.0
range_min = 0.1
range_max = 12.0
rate = 10.0
time_increment = 0.003
flicker = 0.1
noise = 0.01
lost = 0.003

[robot]
waypoints = [[0.0, 0.0], [1.0, 0.5]]
speed = 0.5

[robot.odometry]
topic = "/odom"
delay = 0.15

[robot.mount]
told = false

[[wall]]
points = [[-3.4, -2.9], [4.1, -2.9], [4.1, 3.2], [-3.4, 3.2]]
closed = true

[[box]]
x = 2.1
y = -1.35
length = 0.8
width = 0.6
yaw = 25.0

[[ladder]]
x = 0.9
y = 2.1
length = 0.55
width = 0.45
leg = 0.04
yaw = 15.0

[[plant]]
x = -1.5
y = 1.7
radius = 0.3
seed = 4

[[person]]
gap = 0.25

[person.route]
speed = 1.2
loop = true
corner_radius = 0.5
turn_rate = 90.0
acceleration = 2.0
waypoints = [[0.0, 2.0], { x = 1.0, y = 1.5, wait = 0.1, corner = "stop" }, [2.0, 2.0]]
"""
_HEAD = "[scene]\nsweeps = 2\n[sensor]\nbeams = 9\n"


def _with(line: str, *more: str) -> str:
    """The scene with lines changed: each `key = value` takes the place of the first of its key."""
    text = SCENE
    for given in (line, *more):
        key = given.partition(" = ")[0]
        text = "\n".join(given if it.startswith(f"{key} = ") else it for it in text.splitlines())
    return text


KNOWN: tuple[str, ...] = (
    SCENE,
    "a=" + "[" * 100_000,
    "a=" + "[" * 900 + "]" * 900,
    "a." * 50_000 + "a = 1",
    "a = {" + "b = {" * 20_000,
    "[" + "a." * 50_000 + "a]",
    *("".join(f"[[{'a.' * many}b]]\n" for many in range(1, 600)),),
    *(_with(f"rate = {value}") for value in ("1e-300", "1e300", "inf", "nan", "0", "-1", "99999999999999999999")),
    *(_with(f"beams = {value}") for value in ("0", "-1", "99999999999999999999", "1e30", "9223372036854775807")),
    *(_with(f"sweeps = {value}") for value in ("0", "99999999999999999999", "true")),
    *(_with(f"noise = {value}") for value in ("1e308", "inf", "nan", "-1")),
    *(_with(f"range_max = {value}") for value in ("1e308", "inf", "0.1", "1e-320")),
    _with("waypoints = [[0.0, 0.0], [0.0, 0.0]]"),
    _with("waypoints = [[0.0, 0.0], [1e308, -1e308]]", "speed = 1e308"),
    _with("speed = 1e-300"),
    _with("x = 1e308", "y = -1e308"),
    _with("length = 1e308", "width = 1e308"),
    *(_with(f"time_increment = {value}") for value in ("1e-320", "1e300", "0.0033333333333333335", "nan")),
    *(_with(f"flicker = {value}") for value in ("1e-320", "0.9", "-1")),
    *(_with(f"corner_radius = {value}", f"acceleration = {value}") for value in ("0.001", "1e6", "0")),
    _with("delay = -10.0"),
    _with('name = "\\u0000\\u001b[31m"'),
    _HEAD + "[[wall]]\npoints = [" + "[0.0, 1.0]," * 60_000 + "]\n",
    _HEAD + "[[box]]\nx = 1\ny = 1\n" * 20_000,
    _HEAD + f"[[box]]\nx = {'9' * 5000}\n",
)


def write(place: Place, number: int, random: Random) -> None:
    """A scene made to harm, or a sound one with words or bytes changed."""
    if number < len(KNOWN):
        data = KNOWN[number].encode()
    else:
        data = SCENE.encode()
        if random.integers(4):
            data = mutate_words(SCENE, random).encode("utf-8", "replace")
        if not random.integers(3):
            data = mutate(data, random)
    (place.input / "scene.toml").write_bytes(data)
    log = str(random.choice(["run.csv", "run.mcap", "run.bag", "run.db3"]))
    place.note(commands=[["-q", "simulate", "in/scene.toml", "-o", f"out/{log}", "--sweeps", "2"]])


def scene_targets() -> list[Target]:
    """Scenes."""
    return [Target("scenes", write, judge_commands, weight=150, known=len(KNOWN))]
