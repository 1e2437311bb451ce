"""Folders of ROS 2 bags whose metadata.yaml is mutated or made to harm."""

from __future__ import annotations

from collections.abc import Callable

from tools.fuzz.containers import sample_of
from tools.fuzz.logs import judge_log
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words

NAME = "run/metadata.yaml"
_HEAD = "rosbag2_bagfile_information:\n  version: 8\n  storage_identifier: sqlite3\n  relative_file_paths:\n"


def _naming(*names: str) -> Callable[[str], str]:
    return lambda text: _HEAD + "".join(f"    - {name}\n" for name in names)


def _bomb(text: str) -> str:
    """Nine levels of nine references each."""
    levels = "ihgfedcb"
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [
        f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]"
        for before, name in zip("a" + levels[::-1], levels[::-1], strict=False)
    ]
    return "\n".join(lines) + "\n" + text


KNOWN: tuple[Callable[[str], str], ...] = (
    str,
    _bomb,
    _naming("../../victims/thesis.db3", "../victims/thesis.db3", "/etc/passwd", "..", ".", "/dev/zero"),
    _naming(*(f"not_there_{number}.db3" for number in range(30_000))),
    _naming(*["run.db3"] * 40_000),
    _naming("\x1b[31m.db3", "a" * 5000 + ".db3", "\u202e.db3"),
    lambda text: text.replace("relative_file_paths", "relative_file_paths: [" + "[" * 100_000),
    lambda text: "!!python/object/apply:os.system ['touch victims/new']\n" + text,
    lambda text: "{" * 100_000,
    lambda text: "- " * 200_000,
    lambda text: "\t" * 400_000 + text,
    lambda text: "relative_file_paths:" + " " * 400_000,
    lambda text: "relative_file_paths:\n" * 40_000,
    lambda text: text.encode().decode("utf-16", "replace"),
    lambda text: "",
)
_MANY = 300
"""Storage files in the case of many names."""


def write(place: Place, number: int, random: Random) -> None:
    """The metadata changed, the storage as it is."""
    files = sample_of("ros2-none").files
    text = files[NAME].decode()
    if number < len(KNOWN):
        changed = KNOWN[number](text).encode()
    else:
        changed = mutate_words(text, random).encode()
        if not random.integers(3):
            changed = mutate(changed, random)
    for name, data in files.items():
        (place.input / name).parent.mkdir(exist_ok=True)
        (place.input / name).write_bytes(changed if name == NAME else data)
    if number == 3:
        for other in range(_MANY):
            (place.input / "run" / f"empty_{other}.db3").write_bytes(b"SQLite format 3\0")


def metadata_targets() -> list[Target]:
    """Metadata of a bag."""
    return [Target("metadata", write, lambda place: judge_log(place, place.input / "run"), weight=100, known=len(KNOWN))]
