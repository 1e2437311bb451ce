"""Whether the number of ranges is believed that a line declares: by what stands behind them, and by the other lines."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.carmen.words import Laser
from lidarcli.logs.lines import MOST_DIGITS, left_over
from lidarcli.logs.numbers import Cells, parse_rows
from lidarcli.sweeps import Int64

TAIL = 3
"""Every whole line ends with ipc_timestamp, ipc_hostname and logger_timestamp."""

POSED = (0, 3, 6)
"""Fields behind the ranges: none, the pose of the laser alone, or also that of the robot."""
_POSE = 3
_SOME = 20
"""So many lines show how a writer spells numbers."""
_WHOLE = 11
"""Of lines that tell their geometry: also how the robot moved. A number of remissions, and these, stand before it …"""
_MOVED = (*POSED, 7, 8, 9, 10, _WHOLE)
"""… with which old writers have left some fields out …"""
_BARE = (*POSED, _WHOLE)
"""… or which they have left out itself."""


@dataclass(frozen=True, eq=False, slots=True)
class Sweeps:
    """R lines of one kind, each with enough cells for the ranges that it declares."""

    laser: Laser
    rows: Int64
    beams: Int64
    after: Int64
    """(R,) the first cell behind the ranges."""
    fields: Int64
    """(R,) cells from there to the time; none is negative."""
    rest: Int64
    """(R,) cells from the time on."""

    def of(self, some: list[int]) -> Sweeps:
        """Some of them."""
        parts = (self.rows, self.beams, self.after, self.fields, self.rest)
        return Sweeps(self.laser, *(part[some] for part in parts))


@dataclass(slots=True)
class Counts:
    """Looks at the lines of one log, block after block."""

    _seen: dict[str, Counter[tuple[int, int]]] = field(default_factory=dict)
    """Topic → how many lines so far had so many ranges, and fields behind them."""

    def doubt(self, cells: Cells, sweeps: Sweeps) -> dict[int, str]:
        """Those whose number of ranges cannot be theirs, and why."""
        laser = sweeps.laser
        causes: dict[int, str] = {}
        for at, fields in enumerate(sweeps.fields.tolist()):
            beams, rest = int(sweeps.beams[at]), int(sweeps.rest[at])
            if laser.geometry:
                cause = _doubt_whole(cells, sweeps, at)
            elif fields in (POSED if laser.posed else (0,)):
                cause = ""
            else:
                usual = POSED[-1] if laser.posed else 0
                cause = (
                    _missing(usual - fields, beams) if fields < usual else left_over(fields - usual, beams)
                )
            if not cause and rest > TAIL:
                cause = left_over(rest - TAIL, beams)
            if cause:
                causes[at] = cause
        if laser.posed and not laser.geometry:
            for doubt in (self._doubt_others, _doubt_all):
                fit = [at for at in range(len(sweeps.rows)) if at not in causes]
                causes |= {fit[at]: cause for at, cause in doubt(cells, sweeps.of(fit)).items()}
        return causes

    def _doubt_others(self, _: Cells, sweeps: Sweeps) -> dict[int, str]:
        """Lines with other fields behind the ranges than most of their kind that declare as many."""
        seen = self._seen.setdefault(sweeps.laser.topic, Counter())
        kinds = list(zip(sweeps.beams.tolist(), sweeps.fields.tolist(), strict=True))
        seen.update(kinds)
        usual = {
            beams: max(POSED, key=lambda fields: (seen[beams, fields], fields)) for beams, _ in set(kinds)
        }
        causes = {}
        for at, (beams, fields) in enumerate(kinds):
            more = fields - usual[beams]
            if more:
                causes[at] = left_over(more, beams) if more > 0 else _missing(-more, beams)
        return causes


def _missing(fields: int, beams: int) -> str:
    return (
        f"it declares {beams} ranges, but {'one field is' if fields == 1 else f'{fields} fields are'} missing"
    )


def _doubt_whole(cells: Cells, sweeps: Sweeps, at: int) -> str:
    """Why a line that tells its geometry has not the ranges that it declares; '' where it may have them."""
    laser, beams, fields = sweeps.laser, int(sweeps.beams[at]), int(sweeps.fields[at])
    row, after = sweeps.rows[at : at + 1], int(sweeps.after[at])
    whole, shorter, bare = (_WHOLE, _MOVED, _BARE) if laser.posed else (0, (0,), (0,))
    told = _whole_number(cells.spans(row, after, 1)[0]) if fields else None
    behind = -1 if told is None else fields - 1 - told
    if behind == whole:
        return ""
    # A number of remissions among the ranges, from which on all is as it should be, says how many there are.
    begin = laser.count + 1
    ranges = cells.spans(row, begin, beams)[0].split(cells.separator) if beams else []
    for index in range(beams - 1, -1, -1):
        if _whole_number(ranges[index]) == beams + fields - whole - 1 - index:
            return f"it declares {beams} ranges and has {index}"
    return "" if behind in shorter or fields in bare else left_over(fields, beams)


def _whole_number(cell: bytes) -> int | None:
    return int(cell) if cell.isdigit() and len(cell) <= MOST_DIGITS else None


def _doubt_all(cells: Cells, sweeps: Sweeps) -> dict[int, str]:
    """Lines that all have poses in the place of their last ranges: they declare more than they have."""
    causes: dict[int, str] = {}
    for fields in POSED[:-1]:
        some = np.flatnonzero((sweeps.fields == fields) & (sweeps.after > sweeps.laser.count + 2 * _POSE))
        if len(some) and len(some) == np.count_nonzero(sweeps.fields == fields):
            rows, last = sweeps.rows[some], sweeps.after[some] + fields
            if _are_poses(cells, rows, last, sweeps.laser.count + 1):
                for at in some.tolist():
                    causes[at] = f"it declares {sweeps.beams[at]} ranges, but the last ones are poses"
    return causes


def _are_poses(cells: Cells, rows: Int64, end: Int64, first: int) -> bool:
    """Whether the last six cells before `end` of all `rows` are two poses: the same ones, or spelled unlike ranges."""
    both = cells.spans(rows, end - 2 * _POSE, np.full(len(rows), 2 * _POSE))
    numbers = parse_rows(both, np.full(len(rows), 2 * _POSE), cells.separator, np.float64)
    if numbers.bad:
        return False
    table = numbers.values.reshape(-1, 2 * _POSE)
    same = (table[:, :_POSE] == table[:, _POSE:]).all()
    # Three equal numbers are ranges as well.
    if same and (table[:, :1] != table[:, 1:_POSE]).any():
        return True
    rows, end, both = rows[:_SOME], end[:_SOME], both[:_SOME]
    ranges = cells.spans(rows, first, end - 2 * _POSE - first)
    decimals = {len(cell.partition(b".")[2]) for part in ranges for cell in part.split(cells.separator)}
    others = {len(cell.partition(b".")[2]) for part in both for cell in part.split(cells.separator)}
    return len(decimals) == len(others) == 1 and decimals != others
