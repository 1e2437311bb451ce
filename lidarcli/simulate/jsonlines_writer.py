"""Sweeps as `mcap cat --json` prints them: for `simulate -o run.jsonl` and for tests."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.simulate.decimals import number_or_word, write_lines
from lidarcli.sweeps import RawSweeps

_S = 1_000_000_000


def write_jsonlines(path: Path, blocks: Iterable[RawSweeps]) -> None:
    """Write sweeps as LaserScan messages to `path`, one a line, packed where it ends in `.gz`."""
    write_lines(path, _lines(blocks))


def _lines(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    sequence = 0
    for block in blocks:
        for row in range(len(block)):
            time = f"{np.datetime64(int(block.record_ns[row]), 'ns')}Z"
            line = {
                "topic": block.topic,
                "sequence": sequence,
                "log_time": time,
                "publish_time": time,
                "data": _message(block, row),
            }
            yield json.dumps(line, separators=(",", ":"), allow_nan=False)
            sequence += 1


def _message(block: RawSweeps, row: int) -> dict[str, Any]:
    whole, rest = divmod(int(block.stamp_ns[row]), _S)
    beams = int(block.beams[row])
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    times = [0.0 if each is None else float(each[row]) for each in (block.time_increment, block.scan_time)]
    return {
        "header": {
            "stamp": {"sec": whole, "nanosec": rest},
            "frame_id": block.frame_ids[int(block.frame[row])],
        },
        "angle_min": first,
        "angle_max": first + (beams - 1) * step,
        "angle_increment": step,
        "time_increment": times[0],
        "scan_time": times[1],
        "range_min": number_or_word(float(block.range_min[row])),
        "range_max": number_or_word(float(block.range_max[row])),
        "ranges": [number_or_word(value) for value in block.ranges[row, :beams].tolist()],
        "intensities": []
        if block.intensities is None
        else [number_or_word(value) for value in block.intensities[row, :beams].tolist()],
    }
