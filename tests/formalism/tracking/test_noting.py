"""What a user is told of the poses of a topic, and of scenes in which everything moves."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.formalism.tracking import tracker
from lidarcli.formalism.tracking.tracks import Track


class Estimate:
    """A correction with these values."""

    def __init__(self, delay: float, ahead: float = 0.0, left: float = 0.0, travelled: float = 10.0) -> None:
        self.travelled = travelled
        self.values = (delay, ahead, left, 0.005, 0.01)

    def estimate(self) -> tuple[float, float, float, float, float]:
        """As told."""
        return self.values


def notes(estimate: Estimate, tracks: list[Track], *, poses: bool = True) -> list[str]:
    return tracker.notes_of("/scan", estimate, tracks, poses)  # type: ignore[arg-type]


def test_a_delay_is_told() -> None:
    (line,) = notes(Estimate(0.12), [])
    assert line.startswith("/scan: ")
    assert "0.12 s late" in line
    (line,) = notes(Estimate(-0.12), [])
    assert "the poses 0.12 s early" in line
    assert notes(Estimate(0.12), [], poses=False) == []


def test_the_place_of_the_sensor_is_told_in_words() -> None:
    (line,) = notes(Estimate(0.0, -0.12, 0.05), [])
    assert "0.12 m behind and 0.05 m to the left of its told place" in line


@pytest.mark.parametrize(("poses", "words"), [(False, "it needs poses"), (True, "poses may be wrong")])
def test_a_scene_that_moves_as_a_whole_is_told(poses: bool, words: str) -> None:
    tracks = [Track(sweeps=100, moved=bool(moved)) for moved in np.arange(10) < 8]
    (line,) = notes(Estimate(0.0), tracks, poses=poses)
    assert "8 of 10 tracks move: do not trust agents" in line
    assert words in line
    tracks = [Track(sweeps=100, moved=bool(moved)) for moved in np.arange(10) < 5]
    assert notes(Estimate(0.0), tracks, poses=poses) == []
