"""Set A on real logs, row by row and track by track, against judgements by eye.

A judgement is of the beams that a row had when it was judged, so that numbers of tracks and objects do not matter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

import lidarcli
from benchmarks.annotations.choice import Chosen
from benchmarks.tracking.scoring import Share

LABELS = Path(__file__).parents[1] / "annotations"
"""Folder of the judged rows, `movers_SET.parquet`: log, topic, sweep, first and last beam, verdict, and the number of the
track by which an earlier tracker had the row in set A, for as long as `MIN_SECONDS` or `MIN_SWEEPS`; else 0."""
Set = Literal["chosen", "untouched"]
Carried = Literal["driving", "parked", "outdoors, no poses"]
Beams = tuple[int, int]
MOVER, STATIC = "mover", "static"
BEAMS = ("topic", "sweep", "beam_i", "beam_f")
MIN_SHARED = 0.3
"""Rows and judgements that share fewer of their beams are not of the same thing."""
MIN_SECONDS, MIN_SWEEPS = 1.0, 10
"""Tracks with less of both in set A are not asked."""
MIN_FOUND = 0.5
"""Share of the rows of a mover's track."""
DRAWS, INTERVAL = 2000, (0.025, 0.975)
MIN_LOGS = 3
"""Of fewer recordings there is no interval."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A log, or a stretch of one, whose rows were judged."""

    log: str
    """Path below the folder of the real logs, or below `choice.JUDGED` beside it."""
    topic: str = ""
    pose: str = ""
    stretch: tuple[float, float] | None = None
    """First and last second, without poses."""
    carried: Carried = "driving"
    still: bool = False
    """Nothing moves there: every row in set A is wrong."""

    @property
    def name(self) -> str:
        """As the table of judgements has it."""
        return self.log if self.stretch is None else "{} {:g}-{:g} s".format(self.log, *self.stretch)


CARMEN = "carmen_ple/{}-corrected{}.log.gz"
LOGS: dict[Set, tuple[Judged, ...]] = {
    "chosen": (
        Judged("comprobo24/test-bag", "/scan", still=True),
        Judged("comprobo24/drive_square", "/scan"),
        Judged("DanPark13/finite-state-controller", "/scan"),
        Judged("DanPark13/obstacle-avoider", "/scan"),
        Judged("DanPark13/person_follower", "/scan"),
        Judged("zcoakley/fsm", "/scan"),
        Judged("zcoakley/person_follower", "/scan"),
        Judged("ros_behaviors_fsm/teleop", "/scan"),
        Judged("ros_behaviors_fsm/wall_follower", "/scan"),
        Judged("hrp_mpc_lidar/mylaserdata2.bag"),
        Judged("leg_tracker/negative_2.bag", still=True),
        Judged("leg_tracker_benchmarks/general_tracking_moving_1.bag"),
        Judged("scan_tools/laser_scan_matcher_demo_ros2branch_20230219.bag", still=True),
        Judged("obstacle_detector/scans_demo.bag"),
        Judged("ros2_selfdriving/full_bag_nav", still=True),
        Judged("ros2_selfdriving/circular_bag_framed_0522", still=True),
        Judged("my_gazebo_tutorials/20_53_49", still=True),
        Judged("my_gazebo_tutorials/20_46_08/rosbag2_2024_11_22-20_46_08_0.db3", still=True),
        Judged("datmo_more/intersection.bag"),
        Judged("datmo_more/two_robots.bag"),
        Judged("datmo/overtake_ego.bag"),
        Judged("datmo/parallel.bag"),
        Judged(CARMEN.format("csail", ""), pose="/corrected"),
        Judged(CARMEN.format("freiburg-079", "-first1500"), pose="/corrected"),
        Judged(CARMEN.format("infinite-corridor", "-first1500"), pose="/corrected"),
        Judged(CARMEN.format("seattle", ""), pose="/corrected"),
        Judged(CARMEN.format("belgioioso", ""), pose="/corrected"),
        Judged(CARMEN.format("acapulco", ""), pose="/corrected"),
        Judged(CARMEN.format("edmonton", ""), pose="/corrected", still=True),
    ),
    "untouched": (
        Judged(CARMEN.format("fhw", ""), pose="/corrected"),
        Judged(CARMEN.format("intel", ""), pose="/corrected"),
        Judged(CARMEN.format("orebro", ""), pose="/corrected"),
        Judged("sea_me_coss/room_rosbag", still=True),
        Judged("sea_me_coss/rosbag_data", still=True),
        Judged("real_clients/irs_a1scan.db3", carried="parked"),
        Judged("leg_tracker/positive_1_raw.bag", carried="parked"),
        Judged("leg_tracker/positive_3_raw.bag", carried="parked"),
        Judged("leg_tracker/positive_2_extracted.bag", carried="parked"),
        Judged("leg_tracker/positive_6_extracted.bag", carried="parked"),
        Judged("leg_tracker/demo_stationary_simple_environment.bag", carried="parked"),
        Judged("leg_tracker_benchmarks/person_following_outdoor_1.bag", stretch=(100, 190), carried="outdoors, no poses"),
        Judged("leg_tracker_benchmarks/person_following_outdoor_1.bag", stretch=(420, 500), carried="outdoors, no poses"),
    ),
}


NONE = Share()


@dataclass(frozen=True, slots=True)
class InA:
    """How right set A is, in one log or several; they add up."""

    rows: Share = NONE
    """Rows in set A on movers, of those that were judged."""
    rows_unjudged: int = 0
    movers: Share = NONE
    """Judged rows of movers on whose beams a row in set A lies."""
    tracks: Share = NONE
    """Tracks in set A most of whose judged rows are movers."""
    tracks_unjudged: int = 0
    """Less than half of their rows are judged."""
    mover_tracks: Share = NONE
    """Judged tracks of movers half of whose rows are found."""

    def __add__(self, other: InA) -> InA:
        return InA(
            self.rows + other.rows,
            self.rows_unjudged + other.rows_unjudged,
            self.movers + other.movers,
            self.tracks + other.tracks,
            self.tracks_unjudged + other.tracks_unjudged,
            self.mover_tracks + other.mover_tracks,
        )

    @property
    def shares(self) -> tuple[Share, Share, Share, Share]:
        """Precision and recall by row, then by track."""
        return self.rows, self.movers, self.tracks, self.mover_tracks

    @property
    def empty(self) -> bool:
        """Nothing was in set A, and nothing should have been."""
        return not (self.rows_unjudged or any(share.all for share in self.shares))


@dataclass(frozen=True, slots=True)
class OneLog:
    """The figures of one log."""

    set: Set
    judged: Judged
    in_a: InA


def measure_by_eye(folder: Path, sets: Sequence[Set], jobs: int) -> list[OneLog]:
    """The figures of the logs that are there."""
    listed = [(name, each, Chosen(each.log, "", 0).path(folder)) for name in sets for each in LOGS[name]]
    with ProcessPoolExecutor(jobs) as pool:
        return list(pool.map(_measure, *zip(*(one for one in listed if one[2].exists()), strict=True)))


def _measure(name: Set, each: Judged, path: Path) -> OneLog:
    """Follow the things of one log with default options and compare set A with the judgements."""
    told = pd.read_parquet(LABELS / f"movers_{name}.parquet", filters=[("log", "==", each.name)])
    return OneLog(name, each, score(in_set_a(each, path), told, still=each.still))


def in_set_a(each: Judged, path: Path) -> pd.DataFrame:
    """The rows of a log in set A: topic, sweep, t, first and last beam, track."""
    start, end = each.stretch or (None, None)
    options: dict[str, Any] = {"topic": each.topic, "pose": each.pose, "start": start, "end": end}
    options = {name: value for name, value in options.items() if value}
    found = lidarcli.track(path, trajectories=False, **options)
    columns = ["topic", "sweep", "t", "beam_i", "beam_f", "track", "set"]
    rows: pd.DataFrame = found.objects.select(columns).to_pandas()
    return rows[rows["set"] == "A"].drop(columns="set").astype({"topic": str})


def shared(a: Beams, b: Beams) -> float:
    """Beams of both as a share of those from the first to the last of either; across the seam all or nothing."""
    if a[0] > a[1] or b[0] > b[1]:
        return float(a == b)
    both = min(a[1], b[1]) - max(a[0], b[0]) + 1
    return max(both, 0) / (max(a[1], b[1]) - min(a[0], b[0]) + 1)


def score(rows: pd.DataFrame, told: pd.DataFrame, *, still: bool = False) -> InA:
    """Compare the rows of one log in set A with what was judged there."""
    known: dict[tuple[str, int], list[tuple[Beams, str]]] = {}
    for topic, sweep, first, last, verdict in _values(told, *BEAMS, "verdict"):
        known.setdefault((topic, sweep), []).append(((first, last), verdict))
    seen: dict[tuple[str, int], list[Beams]] = {}
    verdicts = []
    for topic, sweep, first, last in _values(rows, *BEAMS):
        seen.setdefault((topic, sweep), []).append((first, last))
        near = [(shared(beams, (first, last)), verdict) for beams, verdict in known.get((topic, sweep), [])]
        likest, verdict = max(near, key=itemgetter(0), default=(0.0, ""))
        verdicts.append(verdict if likest >= MIN_SHARED else STATIC if still else "")
    rows = rows.assign(mover=[one == MOVER for one in verdicts], static=[one == STATIC for one in verdicts])
    right = Share(int(rows["mover"].sum()), int(rows["mover"].sum() + rows["static"].sum()))
    tracks, unjudged = NONE, 0
    for _, mine in rows.groupby("track"):
        if mine["t"].max() - mine["t"].min() < MIN_SECONDS and mine["sweep"].nunique() < MIN_SWEEPS:
            continue
        movers, statics = int(mine["mover"].sum()), int(mine["static"].sum())
        if movers + statics < len(mine) / 2:
            unjudged += 1
        else:
            tracks += Share(int(movers > statics), 1)
    found, found_tracks = _found(told, seen)
    return InA(right, len(rows) - right.all, found, tracks, unjudged, found_tracks)


def _found(told: pd.DataFrame, seen: Mapping[tuple[str, int], Sequence[Beams]]) -> tuple[Share, Share]:
    """The judged rows of movers, and the tracks of movers, that lie on rows in set A."""
    of_movers = told[told["verdict"] == MOVER]
    found = np.array(
        [
            any(shared((first, last), beams) >= MIN_SHARED for beams in seen.get((topic, sweep), []))
            for topic, sweep, first, last in _values(of_movers, *BEAMS)
        ],
        np.bool_,
    )
    tracks = NONE
    for number, mine in told[told["track"] > 0].groupby("track"):
        if np.count_nonzero(mine["verdict"] == MOVER) > np.count_nonzero(mine["verdict"] == STATIC):
            tracks += Share(int(found[(of_movers["track"] == number).to_numpy()].mean() >= MIN_FOUND), 1)
    return Share(int(found.sum()), len(found)), tracks


def intervals(logs: Sequence[OneLog]) -> list[tuple[float, float] | None]:
    """95 % intervals of the sums of `InA.shares`, by drawing recordings with replacement; None of too few."""
    recordings = sorted({one.judged.log for one in logs})
    sums = {name: sum((one.in_a for one in logs if one.judged.log == name), InA()) for name in recordings}
    result: list[tuple[float, float] | None] = []
    draw = np.random.default_rng(0).integers(len(recordings), size=(DRAWS, len(recordings)))
    for shares in zip(*(sums[name].shares for name in recordings), strict=True):
        counts = np.array([(share.some, share.all) for share in shares])
        some, every = counts[draw].sum(axis=1).T
        enough = np.count_nonzero(counts[:, 1]) >= MIN_LOGS
        low, high = np.quantile(some[every > 0] / every[every > 0], INTERVAL) if enough else (0.0, 0.0)
        result.append((float(low), float(high)) if enough else None)
    return result


def _values(table: pd.DataFrame, *columns: str) -> Iterator[tuple[Any, ...]]:
    return table[list(columns)].itertuples(index=False, name=None)
