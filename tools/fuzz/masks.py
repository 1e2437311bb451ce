"""Masks of the robot itself: mutated files, and TOML made to harm."""

from __future__ import annotations

from tools.fuzz.commands import judge_commands
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.tables import LOG, tables
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words

MASK = """[[mask]]
circle = { x = -0.2, y = 0.0, radius = 0.15 }
[[mask]]
polygon = [[0.6, 0.4], [0.6, -0.4], [-0.3, -0.4], [-0.3, 0.4]]
frame = "base_link"
[[mask]]
sector = { from = 126.0, to = -135.0, nearest = 0.2, farthest = 3.5 }
topic = "/scan"
[[mount]]
frame = "laser"
parent = "base_link"
x = 0.2
yaw = 90.0
"""


def _with(value: str, *names: str) -> str:
    """The file with other values of some keys."""
    text = MASK
    for name in names:
        head, _, tail = text.partition(f"{name} = ")
        end = min(tail.index(mark) for mark in ",}\n" if mark in tail)
        text = f"{head}{name} = {value}{tail[end:]}"
    return text


KNOWN: tuple[str, ...] = (
    MASK,
    "",
    *(_with(value, "radius", "from", "nearest") for value in ("1e300", "-0.0", "1e-320", "nan", "'a'")),
    *(_with(value, "x", "y", "yaw") for value in ("1e6", "-1e6", "1e308", "9" * 5000)),
    MASK + '[[mount]]\nframe = "base_link"\nparent = "laser"\n',
    MASK.replace("base_link", "\\u0000\\u001b[31m"),
    f"[[mask]]\npolygon = [{'[0.0, 1.0], ' * 60_000}]\n",
    "[[mask]]\npolygon = [[0, 0], [0, 0], [0, 0], [0, 0]]\n",
    "".join(f"[[mask]]\npolygon = [{f'[{k}e-3, 0.5], [0.1, -1], [2, 1], ' * 30}]\n" for k in range(200)),
    "[[mask]]\ncircle = { x = 0, y = 0, radius = 1 }\n" * 15_000,
)


def write(place: Place, number: int, random: Random) -> None:
    """A mask made to harm, or a sound one with words or bytes changed."""
    if number < len(KNOWN):
        data = KNOWN[number].encode()
    else:
        data = (mutate_words(MASK, random) if random.integers(4) else MASK).encode("utf-8", "replace")
        if not random.integers(3):
            data = mutate(data, random)
    (place.input / "robot.toml").write_bytes(data)
    (place.input / LOG).write_bytes(tables()[LOG])
    place.note(commands=[["-q", "detect", f"in/{LOG}", "--mask", "in/robot.toml", "-o", "out", "--overwrite"]])


def mask_targets() -> list[Target]:
    """Masks."""
    return [Target("masks", write, judge_commands, weight=60, known=len(KNOWN))]
