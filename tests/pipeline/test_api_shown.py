"""What batches, poses, backgrounds and maps print, and what else a batch offers to who looks at it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import lidarcli
from lidarcli.errors import OptionError
from lidarcli.sweeps.types import STATUSES
from tests.places import SAMPLES

BATCH = """\
SweepBatch /scan: 150 sweeps x 361 beams
  log     drive
  topic   /scan
  frame   laser
  sweeps  0 to 149 (150 sweeps)
  time    2023-11-14T22:13:20.000Z to 2023-11-14T22:13:49.800Z
  beams   361 per sweep
  view    -180.00 to 180.00 deg
  ranges  0.757 to 8.436 m
  status  53,983 valid, 93 no_return, 0 too_close, 74 invalid
  poses   known for 150 sweeps"""
BACKGROUND = """\
Background of /scan: 1 station x 361 beams
  topic     /scan
  frame     laser
  view      -180.00 to 180.00 deg
  sweeps    100
  stations  1, the poses of 0 are known
  r_e       2.901 to 5.199 m
  support   100.0% of the sweeps (median)
  open      0 beams
  unknown   0 beams"""
POSES = """\
SweepPoses of 150 sweeps
  known      for 150 sweeps
  x          -2.63 to 2.60 m
  y          -1.95 to 1.92 m
  yaw        -179.84 to 179.70 deg
  head down  never"""
GRID = """\
Occupancy 188 x 149 cells of 0.05 m
  frame     odom
  x         -4.70 to 4.70 m
  y         -3.75 to 3.70 m
  occupied  1,407 cells
  free      24,467 cells
  unknown   2,138 cells"""


def test_they_print_what_they_are() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    assert str(batch) == BATCH
    assert repr([batch]) == "[<SweepBatch /scan: 150 sweeps x 361 beams>]"
    (background,) = lidarcli.background(SAMPLES / "room_empty.mcap")
    assert str(background) == BACKGROUND
    assert repr(background) == "<Background of /scan: 1 station x 361 beams>"
    grid = lidarcli.map(SAMPLES / "drive.db3")
    assert str(grid) == GRID
    assert (grid.occupied, grid.free, grid.cells.shape) == (1407, 24467, (149, 188))


def test_a_map_leaves_out_agents_and_nothing_else() -> None:
    with pytest.raises(OptionError, match=r"^--without: 'temporary' is not one of agents$"):
        lidarcli.map(SAMPLES / "drive.db3", without="temporary")
    with pytest.raises(TypeError, match=r"no option 'without_agents'; did you mean 'without'\?$"):
        lidarcli.map(SAMPLES / "drive.db3", without_agents=True)
    # Nothing moves there.
    assert str(lidarcli.map(SAMPLES / "drive.db3", without="agents")) == GRID


def test_poses_print_where_the_sensor_was() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    assert batch.poses is not None
    assert str(batch.poses) == POSES
    assert repr(batch.poses) == "<SweepPoses of 150 sweeps>"
    x, upside_down = batch.poses.x.copy(), np.ones(150, np.bool_)
    x[10:] = np.nan
    way = np.tile([0.03, 0.04, 0.1], (150, 1))
    odd = str(replace(batch.poses, x=x, upside_down=upside_down, way=way))
    assert "known      for 10 sweeps\n" in odd
    assert "head down  in 10 sweeps\n" in odd
    assert odd.endswith("way        0.050 m from the first beam to the last")
    none = batch.poses.rows(np.empty(0, np.int64))
    assert repr(none) == "<SweepPoses of 0 sweeps>"
    assert "x          none" in str(none)


def test_a_notebook_shows_them_as_a_table() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    page = replace(batch, log="<b>&", frame_ids=("",))._repr_html_()
    assert page.startswith('<table><caption style="text-align: left"><b>SweepBatch</b> /scan: 150 sweeps x 361 beams<')
    assert ">&lt;b&gt;&amp;</td>" in page
    assert ">without a name</td>" in page
    assert page.count("<tr>") == 10


def test_points_lie_where_the_beams_ended() -> None:
    batch = lidarcli.formalism.sweep([[1.0, 2.0, np.inf, 3.0]], angle_min=0.0, angle_increment=np.pi / 2)
    expected = [[[1, 0], [0, 2], [np.nan, np.nan], [0, -3]]]
    np.testing.assert_allclose(batch.points(), expected, atol=1e-15)


def test_a_batch_as_a_data_frame() -> None:
    (batch,) = lidarcli.read(SAMPLES / "people.csv.gz", end=0.1)
    short = replace(batch, beams=np.array([1081, 3], np.int32), status=batch.status.copy())
    short.status[1, 3:] = lidarcli.Status.PADDING
    frame = short.to_pandas()
    assert [*frame] == ["sweep", "stamp", "beam", "bearing", "range", "status", "intensity", "x", "y"]
    assert frame["intensity"].isna().all()
    (lit,) = lidarcli.read(SAMPLES / "reflectors.mcap", end=0.1)
    for each, kind in ((frame, "float32"), (lit.to_pandas(), "float32")):
        assert each["intensity"].dtype == kind
    np.testing.assert_array_equal(lit.to_pandas()["intensity"], lit.intensities.ravel())
    assert "intensities  60 to 3100 in the sensor's unit" in str(lit)
    assert "intensities" not in str(batch)
    assert frame.groupby("sweep").size().to_dict() == {0: 1081, 1: 3}
    assert [*frame["status"].cat.categories] == [*STATUSES]
    assert frame["stamp"].dtype == pd.DatetimeTZDtype("ns", "UTC")
    found = frame[frame["sweep"] == 0]
    np.testing.assert_array_equal(found["range"], batch.ranges[0])
    np.testing.assert_allclose(np.hypot(found["x"], found["y"]), found["range"], rtol=1e-6)
    np.testing.assert_allclose(np.arctan2(found["y"], found["x"]).dropna(), found["bearing"][found["x"].notna()], atol=1e-9)
    assert (found["status"] == "valid").sum() == np.isfinite(batch.ranges[0]).sum()


def test_a_batch_is_a_sequence_of_sweeps() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    for row in (0, 7, -1, np.int64(149)):
        one = batch[row]
        assert (len(one), one.sweep.tolist(), one.log) == (1, [row % 150], "drive")
        np.testing.assert_array_equal(one.ranges[0], batch.ranges[row])
        assert one.poses.x.tolist() == [batch.poses.x[row]]
        assert np.shares_memory(one.ranges, batch.ranges)
    assert batch[3:9:2].sweep.tolist() == [3, 5, 7]
    assert batch[[5, 2]].sweep.tolist() == batch[np.array([5, 2])].sweep.tolist() == [5, 2]
    assert batch[batch.seconds() >= 29].sweep.tolist() == [145, 146, 147, 148, 149]
    assert len(batch[200:]) == 0
    assert [one.sweep.tolist() for one in batch[:3]] == [[0], [1], [2]]
    assert batch.rows(slice(2, 4)).sweep.tolist() == [2, 3]
    # Sweeps of a batch are batches, too.
    assert lidarcli.detect(batch).equals(lidarcli.detect(list(batch)))
    for row in (150, -151):
        with pytest.raises(IndexError, match=rf"^batch\[{row}\]: the batch has 150 sweeps$"):
            batch[row]
    for odd in ("0", 1.0, None, (0, 1)):
        with pytest.raises(TypeError, match=r"^batch\[.*\]: sweeps are taken by their row, a slice, or an array"):
            batch[odd]
    with pytest.raises(TypeError, match=r"^rows are given as an array, a list or a slice, not as 3: rows\(\[3\]\)$"):
        batch.rows(3)
