"""Zones: TOML and the YAML of Nav2's Collision Monitor, mutated and made to harm, over a log with poses."""

from __future__ import annotations

import math

from tools.fuzz.commands import judge_commands
from tools.fuzz.masks import MASK
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.tables import LOG, tables
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words

ZONES = """[[zone]]
name = "near"
circle = { x = 0.2, y = 0.0, radius = 1.2 }
action = "slowdown"
min_points = 3
trigger = 2
hold = 0.3

[[zone]]
name = "bumper"
frame = "robot"
polygon = [[1.6, 1.4], [1.6, -1.4], [-1.3, -1.4], [-1.3, 1.4]]
count = "things"
topic = "/scan"

[[zone]]
name = "ahead"
frame = "robot"
polygon = [[0.6, 0.4], [0.6, -0.4], [-0.3, -0.4], [-0.3, 0.4]]
action = "approach"
time_before_collision = 3.0
simulation_time_step = 0.2

[[zone]]
name = "door"
frame = "world"
line = [[-1.0, -1.5], [2.0, -1.0]]
"""
NAV2 = """/**:
  ros__parameters:
    use_sim_time: true
    base_frame_id: "base_link"
collision_monitor:
  ros__parameters:
    odom_frame_id: "odom"
    cmd_vel_in_topic: "cmd_vel_raw"
    source_timeout: 5.0
    transform_tolerance: 0.2
    polygons: ["Stop", "Slow", "Ahead", "Fast"]
    Stop:
      type: "circle"
      radius: 0.9
      action_type: "stop"
      min_points: 4
      enabled: true
    Slow:
      type: "polygon"
      points: "[[1.4, 1.3], [1.4, -1.3], [-1.3, -1.3], [-1.3, 1.3]]"
      action_type: "slowdown"
      slowdown_ratio: 0.3
      max_points: 3
      trigger_consecutive_points: 2
    Ahead:
      type: "polygon"
      points: [0.6, 0.4, 0.6, -0.4, -0.3, -0.4, -0.3, 0.4]
      action_type: "approach"
      time_before_collision: 2.0
      simulation_time_step: 0.1
    Fast:
      type: "velocity_polygon"
      action_type: "limit"
      linear_limit: 0.4
      velocity_polygons: ["turn", "drive"]
      holonomic: false
      turn:
        points: "[[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]]"
        linear_min: 0.0
        linear_max: 0.1
        theta_min: -1.0
        theta_max: 1.0
      drive:
        points: "[[1.5, 0.5], [1.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]]"
        linear_min: 0.1
        linear_max: 1.0
        theta_min: -1.0
        theta_max: 1.0
    exclusion_zones: ["Dock"]
    Dock:
      type: "polygon"
      points: "[[-1.0, 0.4], [-1.0, -0.4], [-1.5, -0.4], [-1.5, 0.4]]"
      enabled: true
    observation_sources: ["scan"]
    scan:
      type: "scan"
      topic: "/scan"
"""
FOOTPRINT = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"


def _ring(corners: int) -> str:
    """A polygon of so many corners about the sensor."""
    turns = [math.tau * k / corners for k in range(corners)]
    return f"[{', '.join(f'[{1.5 * math.cos(at):.7f}, {1.5 * math.sin(at):.7f}]' for at in turns)}]"


def _with(text: str, mark: str, key: str, value: str) -> str:
    """The file with another value of a key, wherever it stands."""
    lines = [
        f"{line[: len(line) - len(line.lstrip())]}{key}{mark}{value}" if line.lstrip().startswith(f"{key}{mark}") else line
        for line in text.splitlines()
    ]
    return "\n".join(lines) + "\n"


_NUMBERS = ("1e300", "-1e300", "1e-300", "nan", "inf", "-1", "0", "1_5", "030", "true", "'a'", "9" * 5000)
KNOWN_TOML: tuple[str, ...] = (
    ZONES,
    "",
    *(
        _with(ZONES, " = ", key, value)
        for key in ("min_points", "trigger", "hold", "time_before_collision", "simulation_time_step")
        for value in _NUMBERS
    ),
    *(_with(ZONES, " = ", "circle", f"{{ x = {one}, y = 0.0, radius = {one} }}") for one in _NUMBERS),
    *(_with(ZONES, " = ", "line", f"[[0, 0], [{one}, 1]]") for one in _NUMBERS),
    *(_with(ZONES, " = ", "polygon", _ring(corners)) for corners in (1_000, 30_000)),
    _with(ZONES, " = ", "polygon", "[[0, 0], [1, 1], [1, 0], [0, 1]]"),
    _with(ZONES, " = ", "polygon", "[[0, 0], [1, 1], [2, 2], [0, 0]]"),
    *(_with(ZONES, " = ", "frame", one) for one in ('"/"', '"\\u001b[31m"', '"laser"', '"odom"', '"map"')),
    "".join(f'[[zone]]\nname = "z{k}"\ncircle = {{ x = 0, y = 0, radius = 1 }}\n' for k in range(15_000)),
    "".join(f'[[zone]]\nname = "z{k}"\nline = [[{k}e-3, -2], [1, 2]]\n' for k in range(3_000)),
    ZONES + MASK,
    ZONES + "[[mask]]\ncircle = { x = 0, y = 0, radius = 1e6 }\n",
    ZONES + '[[mount]]\nframe = "base_link"\nparent = "base_link"\n',
)
KNOWN_NAV2: tuple[str, ...] = (
    NAV2,
    "",
    *(
        _with(NAV2, ": ", key, value)
        for key in (
            *("radius", "min_points", "max_points", "source_timeout", "time_before_collision", "linear_max"),
            *("simulation_time_step", "trigger_consecutive_points", "theta_min"),
        )
        for value in (*_NUMBERS, ".inf", ".nan", "1e400")
    ),
    *(
        _with(NAV2, ": ", "points", value)
        for value in ("'[[1e300, 0], [0, 1e300], [-1, -1]]'", "[.nan, 0, 1, 1, 2, 0]", "'[['", f"'{'[' * 900}'")
    ),
    *(_with(NAV2, ": ", "points", f'"{_ring(corners)}"') for corners in (100, 1_500)),
    _with(NAV2, ": ", "polygons", "[" + "'Stop', " * 9_000 + "'Stop']"),
    _with(NAV2, ": ", "base_frame_id", "'\\e[31m'"),
    _with(NAV2, ": ", "type", "'circle'"),
    NAV2.replace("collision_monitor:", "collision_detector:"),
    NAV2.replace("/**:", "/*:\n  /**:"),
    "- " * 30_000,
    "a: &a [*a]",
)


def _write(sound: str, known: tuple[str, ...], name: str) -> Target:
    def write(place: Place, number: int, random: Random) -> None:
        """A file made to harm, or a sound one with words or bytes changed."""
        if number < len(known):
            data = known[number].encode()
        else:
            data = (mutate_words(sound, random) if random.integers(6) else sound).encode("utf-8", "replace")
            if not random.integers(4):
                data = mutate(data, random)
        file = f"in/zones.{name}"
        (place.root / file).write_bytes(data)
        (place.input / LOG).write_bytes(tables()[LOG])
        told = [f"in/{LOG}", "--zones", file]
        # Without objects it takes half the time.
        commands = [["-q", "zones", *told, "-o", "out", "--overwrite", "--footprint", FOOTPRINT, "--no-objects"]]
        if number < len(known) or not number % 16:
            other = (
                ["zones", *told, "--check", "zones.near.events == 0", "--format", "json"],
                ["overlay", *told, "-o", "out/o.mcap", "--overwrite"],
                ["plot", *told, "--sweep", "3", "-o", "out/sweep.png"],
            )
            commands.append(["-q", *other[number // 16 % len(other)]])
        place.note(commands=commands)

    return Target(f"zones-{name}", write, judge_commands, weight=60, known=len(known))


def zone_targets() -> list[Target]:
    """Zones."""
    return [_write(ZONES, KNOWN_TOML, "toml"), _write(NAV2, KNOWN_NAV2, "yaml")]
