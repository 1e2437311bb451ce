"""Sweeps that are judged by eye: which, and how the answers get into the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.annotations.__main__ import judgements
from benchmarks.annotations.choice import CHOSEN, Chosen
from benchmarks.annotations.pieces import pieces
from benchmarks.annotations.sweeps import rows_of
from benchmarks.annotations.table import BUILDING, LABELS, OWN, THING, UNCLEAR, append, read
from tests.places import SAMPLES


def test_a_larger_count_keeps_what_is_judged_and_adds_what_lies_far_from_it() -> None:
    """Two of 100 sweeps, then two more, then again."""
    assert Chosen("log.bag", "/scan", 2).sweeps(100) == [25, 75]
    assert Chosen("log.bag", "/scan", 2).sweeps(100, [25, 75]) == [25, 75]
    assert Chosen("log.bag", "/scan", 4).sweeps(100, [25, 75]) == [0, 25, 50, 75]
    assert Chosen("log.bag", "/scan", 9).sweeps(3, [1]) == [0, 1, 2]


def test_each_chosen_topic_stands_once() -> None:
    """A log that stands twice would count twice."""
    assert len({(each.log, each.topic) for each in CHOSEN}) == len(CHOSEN)


def test_answers_get_into_the_table(tmp_path: Path) -> None:
    chosen = Chosen("samples/room.mcap", "/scan", 1)
    sweeps = rows_of(SAMPLES.parent, chosen)
    batch, row = sweeps[0]
    found = pieces(batch, row)
    (tmp_path / chosen.name).mkdir()
    answers = tmp_path / chosen.name / "0000.txt"
    first = int(found[2].beams[0])
    answers.write_text(f"place room\n\nthing 0 1\nown 2[{first}-{first}]\nunclear 3\nthing 4\n")
    table = tmp_path / "labels.csv"
    table.write_text(LABELS.read_text(encoding="utf-8").splitlines(keepends=True)[0], encoding="utf-8")
    append(judgements(tmp_path, chosen, sweeps, ()), table)
    append(judgements(tmp_path, chosen, sweeps, {0}), table)
    (told,) = read(table)
    assert (told.log, told.topic, told.sweep, told.place) == ("samples/room.mcap", "/scan", 0, "room")
    verdict, thing = told.beams(batch.width)
    for number, (kind, name) in enumerate([(THING, 1), (THING, 1), (BUILDING, 0), (UNCLEAR, 0), (THING, 2), (BUILDING, 0)]):
        own = found[number].beams[number == 2 :]
        assert set(zip(verdict[own].tolist(), thing[own].tolist(), strict=True)) == {(kind, name)}
    assert verdict[first] == OWN
    for wrong in ("place room\nperson 1", f"place room\nthing {len(found)}", "thing 1", "place attic"):
        answers.write_text(wrong)
        with pytest.raises(ValueError, match=r"not in tuple|no piece"):
            append(judgements(tmp_path, chosen, sweeps, ()), table)
    assert np.array_equal(read(table)[0].beams(batch.width)[0], verdict)
