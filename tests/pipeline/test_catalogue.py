"""Catalogue files: what they mean, one clear line for whatever is wrong with them, and labels of objects."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism.matching.catalogue import Catalogue, Thing
from lidarcli.pipeline.inputs.catalogue import read_catalogue
from tests.places import SAMPLES

ROOM = SAMPLES / "room.mcap"
CATALOGUE = SAMPLES / "room.catalogue.toml"
NAMED = "[[thing]]\nname = 'a'\n"
BOX = NAMED + "length = 1.2\nwidth = 0.8\n"


def read(text: str, folder: Path) -> Catalogue:
    path = folder / "things.toml"
    path.write_text(text, encoding="utf-8")
    return read_catalogue(path)


def test_what_a_catalogue_means(tmp_path: Path) -> None:
    catalogue = read(
        """
        [[thing]]
        name = "pallet"
        shape = "prismatic"
        length = 1.2
        width = 0.8
        tolerance = 0.05
        moves = false
        [[thing]]
        name = "Fässchen"
        diameter = 0.3
        [[thing]]
        name = "chair"
        shape = "legged"
        legs = 4
        spacing = [0.4, 0.35]
        [[thing]]
        name = "person"
        legs = 2
        spacing = [0.25]
        [[thing]]
        name = "bush"
        shape = "irregular"
        length = 0.6
        width = 0.5
        """,
        tmp_path,
    )
    assert catalogue.things == (
        Thing("pallet", "prismatic", length=1.2, width=0.8, tolerance=0.05, moves=False),
        Thing("Fässchen", diameter=0.3, tolerance=0.02),
        Thing("chair", "legged", legs=4, spacing=(0.4, 0.35), tolerance=0.02),
        Thing("person", legs=2, spacing=(0.25,), tolerance=0.02),
        Thing("bush", "irregular", length=0.6, width=0.5, tolerance=0.02),
    )
    assert catalogue.as_dict()["things"][1] == {"name": "Fässchen", "diameter": 0.3, "tolerance": 0.02, "moves": True}


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "no [[thing]] in this catalogue"),
        ("[[things]]\nname = 'a'", "the catalogue: unknown key 'things'; did you mean 'thing'?"),
        (BOX + "radius = 1", "unknown key 'radius'; known keys: name, shape, length, "),
        ("[[thing]]\nlength = 1", "'name' is missing"),
        (NAMED, "'length' is missing: the size of a thing is length and width, or diameter, or legs and spacing"),
        (BOX + "shape = 'box'", "'shape' must be one of prismatic, round, legged, irregular, not 'box'"),
        (BOX + BOX, "[[thing]] number 2: 'name' is 'a' as that of number 1: names must be unique"),
        (BOX + "diameter = 1", "'diameter' and 'length' exclude each other: the size of a thing is length"),
        (BOX + "shape = 'round'", "'length' is no size of a round thing: that is diameter"),
        (NAMED + "length = 1\n", "'width' is missing: the size of a thing is length and width, or diameter"),
        (NAMED + "shape = 'legged'\nlegs = 4\n", "'spacing' is missing: the size of a legged thing is legs and spacing"),
        (NAMED + "legs = 4\nspacing = [1]", "'spacing' of more legs is two numbers, as [0.55, 0.45]"),
        (NAMED + "legs = 2\nspacing = [1, 2]", "'spacing' of two legs is one number, as [0.3]"),
        (NAMED + "legs = 9\nspacing = [1, 1]", "'legs' must be at least 2 and at most 8, not 9"),
        (NAMED + "intensity_min = 5\nintensity_max = 4", "'intensity_min' is above intensity_max: 5 and 4"),
        ("thing = [" + "{}," * 1001 + "]", "the catalogue: 'thing' must be a list of 0 to 1,000 values"),
    ],
)
def test_what_is_refused(text: str, line: str, tmp_path: Path) -> None:
    with pytest.raises(OptionError) as caught:
        read(text, tmp_path)
    first = "[[thing]] number 1: " if line.startswith(("'", "unknown")) else ""
    assert str(caught.value).startswith(f"{tmp_path / 'things.toml'}: {first}{line}")
    assert "\n" not in str(caught.value)


def test_what_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UnreadableError, match=r"things.toml: not valid TOML: .*line 1"):
        read("[[thing]", tmp_path)
    with pytest.raises(UnreadableError, match="cannot read the catalogue: No such file"):
        read_catalogue(tmp_path / "none.toml")
    with pytest.raises(UnreadableError, match="larger than a catalogue may be"):
        read("#" * 1_000_001, tmp_path)


def test_limits_of_an_intensity(tmp_path: Path) -> None:
    """With one a thing needs no size."""
    text = "[[thing]]\nname = 'tape'\nintensity_min = 2e6\n[[thing]]\nname = 'pole'\ndiameter = 0.1\nintensity_max = 0\n"
    assert read(text, tmp_path).things == (Thing("tape", intensity_min=2e6), Thing("pole", diameter=0.1, intensity_max=0.0))
    assert Thing("tape", intensity_min=2e6).as_dict()["intensity_min"] == 2e6
    assert Thing("pole", diameter=0.1, intensity_max=0.0).as_dict()["intensity_max"] == 0.0


def test_reflectors_are_told_from_poles_of_their_size() -> None:
    """In single sweeps, and of tracks by all of them."""
    options: dict[str, Any] = {"catalogue": SAMPLES / "reflectors.catalogue.toml"}
    log = SAMPLES / "reflectors.mcap"
    alone, followed = lidarcli.detect(log, **options), lidarcli.track(log, **options).objects
    for table, least in ((alone, 50), (followed, 60)):
        found = Counter(zip(table["intensity"].to_pylist(), table["label"].to_pylist(), strict=True))
        named = {key: count for key, count in found.items() if key[1] is not None}
        assert {*named} == {(3100.0, "reflector"), (2800.0, "reflector"), (60.0, "pole")}
        assert min(named.values()) >= least


def labels(**options: Any) -> Counter[tuple[int, str | None]]:
    found = lidarcli.detect(ROOM, catalogue=CATALOGUE, **options)
    return Counter(zip(found["object"].to_pylist(), found["label"].to_pylist(), strict=True))


def test_the_boxes_of_the_room_have_names() -> None:
    """Of the ladder one rail is seen in a sweep; and what looks irregular once may be anything that is not seen well."""
    assert labels() == {
        (1, "smaller brown box"): 99,
        (1, None): 1,
        (2, "brown box"): 100,
        (3, "brown box"): 100,
        (4, None): 100,
        (5, None): 99,
    }


FIVE = [
    ("smaller brown box", "prismatic"),
    ("brown box", "prismatic"),
    ("brown box", "prismatic"),
    ("ladder", "legged"),
    ("plant", "irregular"),
]


def test_all_sweeps_together_name_the_ladder_and_the_plant_too() -> None:
    """Every row of a thing and the thing itself have its name, and no other."""
    found = lidarcli.track(ROOM, catalogue=CATALOGUE)
    assert list(zip(*(found.tracks[name].to_pylist() for name in ("label", "shape")), strict=True)) == FIVE
    assert all(0.95 <= score <= 1.0 for score in found.tracks["label_score"].to_pylist())
    rows = Counter(zip(found.objects["track"].to_pylist(), found.objects["label"].to_pylist(), strict=True))
    expected = {(track, label): 100 for track, (label, _) in enumerate(FIVE, 1)}
    assert rows == expected | {(4, "ladder"): 99}
    assert json.loads(found.tracks.schema.metadata[b"lidarcli.parameters"])["catalogue"]["things"]


def test_names_of_tracks_do_not_depend_on_batches() -> None:
    """600 sweeps, so that several windows name their rows by what was seen until then."""
    (once,) = lidarcli.read(ROOM)
    size = len(once)
    laps = [replace(once, sweep=once.sweep + k * size, stamp_ns=once.stamp_ns + k * 10**10) for k in range(6)]
    tables = [
        lidarcli.track(
            [lap.rows(np.arange(at, min(at + step, size))) for lap in laps for at in range(0, size, step)],
            catalogue=read_catalogue(CATALOGUE),
        )
        for step in (size, 7)
    ]
    for one, other in zip(*tables, strict=True):
        assert one.equals(other)
    assert tables[0].tracks["label"].to_pylist() == [label for label, _ in FIVE]


def test_the_rectangle_around_the_legs_is_that_of_the_thing() -> None:
    """The ladder of the sample stands at (0.9, 2.1), turned by 15 degrees, its rails 0.47 x 0.41 m apart."""
    (ladder,) = (row for row in lidarcli.track(ROOM).tracks.to_pylist() if row["shape"] == "legged")
    assert (ladder["x"], ladder["y"]) == pytest.approx((0.9, 2.1), abs=0.05)
    assert (ladder["length"], ladder["width"]) == pytest.approx((0.47, 0.41), abs=0.08)
    assert ladder["yaw"] == pytest.approx(np.radians(15.0), abs=0.15)
    assert ladder["label"] is None
