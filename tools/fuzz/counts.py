"""Text logs whose lines do not hold as many ranges as they say, and sweeps whose ranges pile up at one value."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from tools.fuzz.logs import judge_log
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target

SWEEPS, BEAMS = 60, 36
_POSES = "1.1 2.0 0.0 1.0 2.0 0.0"
_PLAYER = "{stamp:.3f} 16777343 6665 laser 00 001 001 0007 -1.5708 +1.5708 +0.08976 +80.0 {said:04d} {pairs}"
_FILES = {
    "run.log": lambda said, stamp, ranges: f"FLASER {said} {' '.join(ranges)} {_POSES} {stamp:.1f} host {stamp:.1f}",
    "run.txt": lambda said, stamp, ranges: _PLAYER.format(
        said=said, stamp=1e9 + stamp, pairs=" ".join(f"{each} 7" for each in ranges)
    ),
}
"""Name → the line of a sweep that says it has so many ranges, at a time [s]."""
_ODD: tuple[tuple[int, int], ...] = ((0, 0), (0, -1), (0, 1), (BEAMS, 0), (-BEAMS, 0), (0, -BEAMS), (1, 1))
"""By so much what is said is more, and what is given."""
_PILES = (30.0, 51.15, 65.533, 12.01, 1e-3)
_KNOWN = [(name, odd, pile) for name in _FILES for odd in _ODD for pile in _PILES[:2]]


def write(place: Place, number: int, random: Random) -> None:
    """Each oddity of the counts in turn, then any at some of the lines."""
    name, odd, pile = _KNOWN[number % len(_KNOWN)]
    share = 1.0
    if number >= len(_KNOWN):
        odd = int(random.integers(-2, 3)), int(random.integers(-2, 3))
        pile, share = _PILES[int(random.integers(len(_PILES)))], float(random.random())
    wrong, lines = 0, []
    line: Callable[[int, float, list[str]], str] = _FILES[name]
    for sweep in range(SWEEPS):
        is_odd = odd != (0, 0) and float(random.random()) <= share
        said, given = (BEAMS + odd[0], BEAMS + odd[1]) if is_odd else (BEAMS, BEAMS)
        wrong += said != given
        ranges = [f"{pile if random.random() < 0.2 else 2.0 + 8.0 * random.random():.3f}" for _ in range(max(given, 0))]
        lines.append(line(max(said, 0), 10.0 + 0.1 * sweep, ranges))
    (place.input / name).write_text("\n".join([*lines, ""]), encoding="utf-8")
    place.note(log=name, wrong=wrong)


def judge(place: Place) -> Iterator[str]:
    """No line is a sweep whose count is wrong."""
    notes = place.noted()
    path = place.input / str(notes["log"])
    yield from judge_log(place, path)
    report = ReadReport()
    with open_log(str(path)) as log:
        found = sum(map(len, log.scans(None, report)))
    if found != SWEEPS - int(notes["wrong"]):
        yield f"{found} of {SWEEPS} sweeps are read, and {notes['wrong']} have a wrong count"


def count_targets() -> list[Target]:
    """Counts that lie."""
    return [Target("counts", write, judge, weight=10, known=len(_KNOWN))]
