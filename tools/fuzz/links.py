"""Outputs whose names, and whose guessable temporary names, are taken by links to victims, pipes, folders, or the input."""

from __future__ import annotations

import os
from pathlib import Path

from tools.fuzz.commands import judge_commands
from tools.fuzz.place import Place
from tools.fuzz.scenes import SCENE
from tools.fuzz.tables import LOG, put
from tools.fuzz.target import Random, Target

TABLE = "in/run.objects.parquet"
COMMANDS: tuple[tuple[list[str], tuple[str, ...]], ...] = (
    (
        ["-q", "detect", f"in/{LOG}", "-o", "out", "--beams"],
        tuple(f"run.{it}.parquet" for it in ("objects", "sweeps", "beams")),
    ),
    *((["report", TABLE, "-o", f"out/r.{suffix}"], (f"r.{suffix}",)) for suffix in ("html", "json", "txt", "xml", "md")),
    (["background", "build", f"in/{LOG}", "-o", "out/b.parquet"], ("b.parquet",)),
    (
        ["simulate", "in/scene.toml", "-o", "out/s.csv", "--sweeps", "2"],
        ("s.csv", "s.truth.parquet", "s.truth-beams.parquet"),
    ),
    (["simulate", "in/scene.toml", "-o", "out/bag", "--sweeps", "2"], ("bag", "bag.truth.parquet")),
    (["plot", f"in/{LOG}", "--sweep", "1", "-o", "out/p.png"], ("p.png",)),
)
"""Command, and the names below out/ that it writes."""
_RARELY = 1
"""The last so many of `COMMANDS` are slow, and drawn ten times more rarely."""
KINDS = ("thesis", "thesis.db3", "locked", "folder", "folder/inside", "pipe", "new", "folder/new", "hard", "dir", "loop")
"""A victim to link to (`new` ones are not there yet), a hard link to one, a folder, a link to itself."""
SWAPS: tuple[list[str], ...] = (
    ["background", "build", f"in/{LOG}", "-o", f"in/{LOG}"],
    ["simulate", "in/scene.toml", "-o", "in/scene.toml", "--container", "csv", "--sweeps", "2"],
    ["report", TABLE, "-o", TABLE, "--format", "json"],
    ["report", TABLE, "-o", "in/run.sweeps.parquet", "--format", "json"],
    ["report", TABLE, "--log", f"in/{LOG}", "-o", f"in/{LOG}", "--format", "html"],
    ["plot", f"in/{LOG}", "--sweep", "1", "-o", f"in/{LOG}"],
    ["background", "build", f"in/{LOG}", "-o", "out/b.parquet", "--plot", f"in/{LOG}"],
    ["detect", f"in/{LOG}", "-o", "in", "--background", "in/run.objects.parquet"],
    ["background", "build", f"in/{LOG}", "-o", "out/alias.mcap"],
    ["background", "build", f"in/{LOG}", "-o", "in/../in/run.mcap"],
)
"""Commands one of whose outputs is one of their inputs: an error, whatever --overwrite says."""


def write(place: Place, number: int, random: Random) -> None:
    """Each swap, each planted temporary name, then anything."""
    put(place)
    (place.input / "scene.toml").write_text(SCENE, encoding="utf-8")
    os.link(place.input / LOG, place.out / "alias.mcap")
    if number < len(SWAPS):
        place.note(commands=[[*SWAPS[number], "--overwrite"]])
        return
    planted = number - len(SWAPS)
    if planted < len(COMMANDS):
        command, names = COMMANDS[planted]
        for name in names:
            _plant(place, f".{name}.part", "thesis")
        place.note(commands=[command])
        return
    slow = not random.integers(10 * len(COMMANDS))
    quick = len(COMMANDS) - _RARELY
    command, names = COMMANDS[quick + int(random.integers(_RARELY)) if slow else int(random.integers(quick))]
    for name in names:
        if not random.integers(3):
            continue
        kind = KINDS[int(random.integers(len(KINDS)))]
        _plant(place, name if not random.integers(3) else _TEMPORARY[int(random.integers(len(_TEMPORARY)))](name), kind)
    place.note(commands=[[*command, *(["--overwrite"] if random.integers(3) else [])]])


_TEMPORARY = (
    lambda name: f".{name}.part",
    lambda name: f"{name}.part",
    lambda name: f".{Path(name).stem}.part",
    lambda name: f"{name}.tmp",
)
"""Names that a program might write under first."""


def _plant(place: Place, name: str, kind: str) -> None:
    path = place.out / name
    if os.path.lexists(path):
        return
    if kind == "dir":
        path.mkdir()
    elif kind == "hard":
        os.link(place.victims / "thesis", path)
    elif kind == "loop":
        path.symlink_to(name)
    else:
        path.symlink_to(place.victims / kind)


def link_targets() -> list[Target]:
    """Planted names."""
    return [Target("links", write, judge_commands, weight=60, known=len(SWAPS) + len(COMMANDS))]
