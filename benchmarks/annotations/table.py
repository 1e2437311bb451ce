"""The judgements as a table: one row for each stretch of beams, and how they get there from the answers to the pictures."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.annotations.pieces import MAX_LOST, Piece
from lidarcli.sweeps.types import Bool, Int64

Verdict = Literal["building", "thing", "own", "unclear"]
VERDICTS: tuple[Verdict, ...] = ("building", "thing", "own", "unclear")
BUILDING, THING, OWN, UNCLEAR = range(4)
NOT_JUDGED, STRAY = -1, -2
PLACES = ("open", "lab", "room", "corridor")
LABELS = Path(__file__).with_name("labels.csv")
_TOKEN = re.compile(r"(\d+)(?:\[(\d+)-(\d+)\])?$")


@dataclass(frozen=True, eq=False, slots=True)
class Judged:
    """One sweep of B beams."""

    log: str
    topic: str
    sweep: int
    place: str
    verdict: Int64
    """(B,) code into `VERDICTS`; for beams in no piece `STRAY` where they have a range, else `NOT_JUDGED`."""
    thing: Int64
    """(B,) number of the thing, from 1 on; 0 for what is none."""


def answered(text: str, found: list[Piece], has_range: Bool) -> tuple[str, Int64, Int64]:
    """Return place, verdicts and numbers of things (B,) by a file of answers; ValueError where it cannot be read.

    `has_range` (B,): which beams have one.
    """
    verdict = np.where(has_range, STRAY, NOT_JUDGED)
    thing = np.zeros(len(has_range), np.int64)
    for piece in found:
        verdict[piece.beams] = BUILDING
    place, number = "", 0
    for word, *words in filter(None, map(str.split, text.splitlines())):
        if word == "place":
            (place,) = words
            continue
        kind = VERDICTS.index(word)
        number += kind == THING
        for name in words:
            token = _TOKEN.match(name)
            if token is None or int(token[1]) >= len(found):
                raise ValueError(f"no piece: {name}")
            own = found[int(token[1])].beams
            if token[2]:
                first, last = int(token[2]), int(token[3])
                own = own[(own >= first) & (own <= last) if first <= last else (own >= first) | (own <= last)]
            verdict[own], thing[own] = kind, number if kind == THING else 0
    return PLACES[PLACES.index(place)], verdict, thing


def append(sweeps: Iterable[Judged], path: Path = LABELS) -> None:
    """Append sweeps to the table; beams of one verdict and thing in a row are one stretch."""
    with path.open("a", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        for each in sweeps:
            code = each.verdict * 1000 + each.thing
            judged = np.flatnonzero(each.verdict >= 0)
            if not len(judged):
                continue
            # Few lost beams lie within the stretch of their neighbours; a stray, which was not judged, ends it.
            strays = np.cumsum(each.verdict == STRAY)[judged]
            breaks = (np.diff(code[judged]) != 0) | (np.diff(judged) > MAX_LOST + 1) | (np.diff(strays) > 0)
            for part in np.split(judged, np.flatnonzero(breaks) + 1):
                kind, number = divmod(int(code[part[0]]), 1000)
                row = (each.log, each.topic, each.sweep, each.place, part[0], part[-1], VERDICTS[kind], number)
                table.writerow(row)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A row of the table: beams `first` to `last` of a sweep."""

    first: int
    last: int
    verdict: int
    thing: int


@dataclass(frozen=True, slots=True)
class Sweep:
    """The judgements on one sweep."""

    log: str
    topic: str
    sweep: int
    place: str
    stretches: tuple[Stretch, ...]

    def beams(self, count: int) -> tuple[Int64, Int64]:
        """(B,) verdicts and (B,) things of a sweep of so many beams."""
        verdict = np.full(count, NOT_JUDGED, np.int64)
        thing = np.zeros(count, np.int64)
        for each in self.stretches:
            verdict[each.first : each.last + 1] = each.verdict
            thing[each.first : each.last + 1] = each.thing
        return verdict, thing


def read(path: Path = LABELS) -> list[Sweep]:
    """The table."""
    found: dict[tuple[str, str, int, str], list[Stretch]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            key = (row["log"], row["topic"], int(row["sweep"]), row["place"])
            code = VERDICTS.index(row["verdict"])
            stretch = Stretch(int(row["first"]), int(row["last"]), code, int(row["thing"]))
            found.setdefault(key, []).append(stretch)
    return [Sweep(*key, tuple(stretches)) for key, stretches in found.items()]
