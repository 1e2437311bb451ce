"""Agents of whole logs: an office that is drawn as real as it gets, and recordings in which nothing moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs

pytestmark = pytest.mark.slow


def tracked(log: Path, folder: Path) -> tuple[pa.Table, pa.Table]:
    """The objects and the tracks of a log."""
    assert run(["-q", "track", str(log), "-o", str(folder), "--no-trajectories"]) == 0
    objects, tracks = (pq.read_table(next(folder.glob(f"*.{name}.parquet"))) for name in ("objects", "tracks"))
    return objects, tracks


def test_the_people_of_an_office_are_its_agents(tmp_path: Path) -> None:
    """A robot drives past doors, chairs and tables; its odometry drifts, and the path is corrected by its sweeps."""
    log = tmp_path / "office.mcap"
    assert run(["-q", "simulate", str(SAMPLES / "office.toml"), "-o", str(log)]) == 0
    objects, tracks = tracked(log, tmp_path)
    drawn, beams = (pq.read_table(tmp_path / f"office.{name}.parquet") for name in ("truth", "truth-beams"))
    people = drawn.filter(pc.equal(drawn["kind"], "person"))
    # With fewer beams on them they are seen between doors and table legs.
    clear = people.filter(pc.and_(people["moving"], pc.greater_equal(people["beams"], 8)))
    entity = np.full((480, 1440), -1)
    entity[beams["sweep"].to_numpy(), beams["beam"].to_numpy()] = beams["entity"].to_numpy()
    agents = objects.filter(pc.equal(objects["set"], "A"))
    sweep, first, last = (agents[name].to_pylist() for name in ("sweep", "beam_i", "beam_f"))
    around = [np.arange(i, f + 1 + 1440 * (f < i)) % 1440 for i, f in zip(first, last, strict=True)]
    hit = [int(np.bincount(entity[s, at] + 1).argmax()) - 1 for s, at in zip(sweep, around, strict=True)]
    assert len(hit) > 1000
    assert np.isin(hit, people["entity"]).mean() > 0.99
    shown = set(zip(sweep, hit, strict=True))
    goes = list(zip(clear["sweep"].to_pylist(), clear["entity"].to_pylist(), strict=True))
    shares = {one: np.mean([each in shown for each in goes if each[1] == one]) for _, one in goes}
    # The fourth crosses behind walls.
    assert len(shares) == 3
    assert min(shares.values()) > 0.9, shares
    # Tables and doors hide people, who are other tracks afterwards.
    assert 3 <= pc.sum(pc.equal(tracks["set"], "A")).as_py() <= 7


@needs_real_logs
@pytest.mark.parametrize(
    ("log", "most"),
    [
        # People left the building before; three sensors on the robot see its own body.
        pytest.param("leg_tracker/negative_2.bag", 60, id="negative_2"),
        pytest.param("comprobo24/test-bag", 0, id="test-bag"),
    ],
)
def test_where_nobody_is_hardly_a_row_is_an_agent(log: str, most: int, tmp_path: Path) -> None:
    objects, _ = tracked(REAL_LOGS / log, tmp_path)
    assert objects.num_rows > 1000
    assert objects.filter(pc.equal(objects["set"], "A")).num_rows <= most
