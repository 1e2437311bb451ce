"""Numbers in options, beyond what anybody means."""

from __future__ import annotations

from tools.fuzz.commands import judge_commands
from tools.fuzz.place import Place
from tools.fuzz.scenes import SCENE
from tools.fuzz.tables import LOG, put
from tools.fuzz.target import Random, Target

NUMBERS = (
    *("99999999999999999999", "9223372036854775807", "9223372036854775808", "-9223372036854775809"),
    *("1099511627776", "2147483648", "0", "-1", "1e300", "1e-300", "inf", "-inf", "nan", "1e400", "", "x", "0x10"),
    *("1_000", "٣", "9" * 400),
)
_DETECT = ["-q", "detect", f"in/{LOG}", "-o", "out", "--overwrite"]
_TRACK = ["-q", "track", f"in/{LOG}", "-o", "out", "--overwrite"]
_BUILD = ["-q", "background", "build", f"in/{LOG}", "-o", "out/b.parquet", "--overwrite"]
_MAP = ["-q", "map", f"in/{LOG}", "-o", "out/m.yaml", "-o", "out/m.ply", "--overwrite"]
_SIMULATE = ["-q", "simulate", "in/scene.toml", "-o", "out/run.csv", "--overwrite"]
OPTIONS = [
    *(
        (_DETECT, name)
        for name in (
            *("--max-gap", "--min-beams", "--every", "--max-width", "--group-gap", "--threshold", "--start"),
            *("--end", "--jobs", "--no-return", "--fov", "--angle-increment", "--range-max"),
        )
    ),
    *((_TRACK, name) for name in ("--agent-score", "--every")),
    *((_BUILD, name) for name in ("--station-distance", "--station-angle", "--every")),
    *(
        (_MAP, name)
        for name in (
            *("--resolution", "--min-move", "--min-hits", "--occupied-ratio", "--free-no-return"),
            *("--max-size", "--voxel", "--pose-delay"),
        )
    ),
    *((_SIMULATE, name) for name in ("--seed", "--duration", "--sweeps")),
]
_PAIRS = [(option, number) for number in NUMBERS for option in OPTIONS]


def write(place: Place, number: int, random: Random) -> None:
    """Every pair of option and number in turn, then two at once."""
    put(place)
    (place.input / "scene.toml").write_text(SCENE, encoding="utf-8")
    (command, option), value = _PAIRS[number % len(_PAIRS)]
    arguments = [*command, f"{option}={value}"]
    if number >= len(_PAIRS):
        others = [name for other, name in OPTIONS if other is command]
        name = others[int(random.integers(len(others)))]
        arguments.append(f"{name}={NUMBERS[int(random.integers(len(NUMBERS)))]}")
    place.note(commands=[arguments])


def number_targets() -> list[Target]:
    """Options."""
    return [Target("numbers", write, judge_commands, weight=40, known=len(_PAIRS))]
