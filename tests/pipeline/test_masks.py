"""Masks of the robot itself: their files, where frames come from, and learning them from a log."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.errors import LidarcliError, OptionError, UnreadableError
from lidarcli.pipeline.inputs.masks import mask_text, masks_of, plain, read_masks
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.reading.masking import MaskRules, masking_of
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.simulation.generate import simulate_odometry, simulate_sweep_arrays
from lidarcli.simulation.scene import PARKED, Entity, Odometry, Scene, SceneMotion, load_scene
from lidarcli.simulation.scene import SceneMount as Laser
from lidarcli.simulation.writers import write_mcap
from lidarcli.sweeps.masks import Circle, Mask, Masks, Mount, Polygon, Sector
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import Int32, RawSweeps, Status
from tests.fake_log import FakeLog
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.sweeping import raw_sweeps

POSTS = np.array([[-0.3, 0.12, 0.02], [-0.3, -0.12, 0.02], [-0.15, 0.5, 0.05]])
"""x, y, radius of what the robot carries, as the laser sees it [m]."""
AUTO = RangeRules(masks=Masks(learn=True))


def with_body(scene: Scene) -> Scene:
    """The scene with posts on the robot itself."""
    body = Entity("box", 0, 0, 0, 1, 1, circles=POSTS, motion=SceneMotion(route=scene.path))  # type: ignore[arg-type]
    return replace(scene, entities=(*scene.entities, body))


def drawn(scene: Scene, sweeps: int) -> tuple[RawSweeps, Int32]:
    """The sweeps of a scene, and the (B,) sweeps in which each beam ends on its last entity."""
    raw, entity, entities = simulate_sweep_arrays(scene, sweeps)
    return raw, np.count_nonzero(entity == len(entities) - 1, axis=0).astype(np.int32)


@pytest.fixture(scope="module")
def drive() -> Scene:
    return with_body(load_scene(SAMPLES / "drive.toml"))


@pytest.fixture(scope="module")
def log(drive: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot with a body that drives around, with odometry."""
    path = tmp_path_factory.mktemp("body") / "body.mcap"
    write_mcap(path, [drawn(drive, 150)[0]], poses=simulate_odometry(drive, 150))
    return path


def learned(path: Path, poses: PoseOptions | None = None) -> MaskRules:
    with open_source(Source(str(path), "log")) as opened:
        return masking_of(opened, AUTO, poses)


def columns(masks: Masks | None, raw: RawSweeps) -> set[int]:
    """The beams of the first sweep that look through a mask, however far they reach."""
    found: set[int] = set()
    for r in np.arange(0.005, 2.0, 0.005):
        ranges = np.full((1, raw.ranges.shape[1]), r, np.float32)
        found |= set(np.flatnonzero((masks or Masks()).under(raw.rows(slice(0, 1)), ranges)).tolist())
    return found


def test_what_a_file_means(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        """
        [[mask]]
        circle = { x = -0.2, y = 0, radius = 0.15 }
        [[mask]]
        polygon = [[0, 0], [0.5, 0], [0.5, 0.5]]
        frame = "base_link"
        [[mask]]
        sector = { from = 90, to = -90, farthest = 0.4 }
        topic = "/rear"
        [[mount]]
        frame = "laser"
        parent = "base_link"
        x = 0.2
        yaw = 180
        """
    )
    masks = read_masks(str(path))
    assert masks.masks == (
        Mask(Circle(-0.2, 0.0, 0.15)),
        Mask(Polygon(((0.0, 0.0), (0.5, 0.0), (0.5, 0.5))), frame="base_link"),
        Mask(Sector(math.pi / 2, -math.pi / 2, 0.0, 0.4), topic="/rear"),
    )
    assert masks.mounts == (Mount("laser", "base_link", 0.2, 0.0, math.pi),)
    assert masks.path == str(path)
    assert plain(masks_of("again", plain(masks))) == plain(masks)


QUOTE = "'"
CIRCLE = "[[mask]]\ncircle = { x = 0, y = 0, radius = 1 }\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no [[mask]] in this file"),
        ("[[mask]]", "'circle' is missing: a mask is a circle, polygon or sector"),
        (CIRCLE + "polygon = []", "'polygon' and 'circle' exclude each other: a mask has one shape"),
        (CIRCLE + "[[mask]]\ncircel = 1", "[[mask]] number 2: unknown key 'circel'; did you mean 'circle'?"),
        ("[[mask]]\ncircle = { x = 0, y = 0, radius = 0 }", "circle: 'radius' must be above 0"),
        ("[[mask]]\nsector = { from = 0, to = 9, nearest = 1, farthest = 0.5 }", "sector: 'farthest' must be at least 1.0"),
        ("[[mask]]\nsector = { from = 0, to = 9 }\nframe = 'base'", "'frame' and 'sector' exclude each other"),
        (CIRCLE + "[[mount]]\nframe = 'a'", "[[mount]] number 1: 'parent' is missing"),
        (
            CIRCLE + "[[mount]]\nframe = 'a'\nparent = '/a'",
            "[[mount]] number 1: 'parent' leads back to where it began, by the frames a",
        ),
        (
            CIRCLE + "".join(f"[[mount]]\nframe = '{a}'\nparent = '{b}'\n" for a, b in ("xa", "ab", "bc", "ca")),
            "[[mount]] number 1: 'parent' leads back to where it began, by the frames a, b, c, x",
        ),
        ("[[mask", "not valid TOML"),
    ],
)
def test_whatever_is_wrong_is_one_line(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    with pytest.raises(LidarcliError) as caught:
        lidarcli.detect(SAMPLES / "room.mcap", mask=path)
    assert str(caught.value).startswith(f"{path}: ")
    if not says.startswith(("no ", "not ", "[[")):
        says = f"[[mask]] number 1{': ' if says[0] == QUOTE else ', '}{says}"
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, UnreadableError if "TOML" in says else OptionError)


def test_masked_beams_are_on_nothing_and_stay_in_the_sums(tmp_path: Path) -> None:
    log = SAMPLES / "room.mcap"
    path = tmp_path / "robot.toml"
    path.write_text("[[mask]]\nsector = { from = -180, to = 0 }\n")
    sweeps = lidarcli.tables(log, mask=path).sweeps
    statuses = sweeps[["valid", "no_return", "too_close", "invalid", "masked"]]
    assert (statuses.sum(axis=1) == sweeps["beams"]).all()
    assert (sweeps["masked"] > 170).all()
    objects = lidarcli.detect(log, mask=path)
    assert len(objects)
    assert (objects["y"].to_numpy() > 0).all()
    assert lidarcli.info(log, mask=path)[0]["scans"][0]["beams_by_status"]["masked"] == sweeps["masked"].sum()
    [batch, *_] = lidarcli.read(log, mask=path)
    assert (batch.to_pandas()["status"] == "masked").sum() == sweeps["masked"][: len(batch)].sum()


def test_a_mask_for_a_topic_that_is_not_there_is_told(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(CIRCLE + "topic = '/rear'\n" + CIRCLE + "topic = 'scan'\n")
    with pytest.warns(UserWarning, match=r"room.mcap: --mask: no topic /rear in this log, for which a \[\[mask\]\] is$"):
        lidarcli.detect(SAMPLES / "room.mcap", mask=path)


def test_a_map_says_nothing_where_the_robot_is_in_the_way(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("[[mask]]\nsector = { from = -180, to = 180 }\n")
    with pytest.warns(UserWarning, match="no cell is occupied"):
        found = lidarcli.map(log, mask=path, free_no_return=1.0)
    # Beams that the sensor loses are what is left.
    assert np.count_nonzero(found.cells == 0) < 0.05 * np.count_nonzero(lidarcli.map(log).cells == 0)


def test_tf_places_the_frame_of_a_mask(drive: Scene, tmp_path: Path) -> None:
    laser = Laser((0.2, 0.0, math.pi / 2))
    odometry = replace(drive.odometry or Odometry(), tf=True)
    scene = replace(drive, mount=laser, odometry=odometry)
    path = tmp_path / "mounted.mcap"
    write_mcap(path, [drawn(scene, 10)[0]], poses=simulate_odometry(scene, 10))
    file = tmp_path / "robot.toml"
    # 0.3 m ahead of the laser, which looks to the left of the robot.
    file.write_text(f"[[mask]]\nframe = '{odometry.child_frame_id}'\ncircle = {{ x = 0.2, y = 0.3, radius = 0.05 }}\n")
    with open_source(Source(str(path), "log")) as opened:
        rules = masking_of(opened, RangeRules(masks=read_masks(str(file)))).rules
    assert rules.masks is not None
    raw = drawn(scene, 1)[0]
    bearings = raw.angle_min[0] + raw.angle_increment[0] * np.arange(raw.ranges.shape[1])
    masked = rules.masks.under(raw, np.full_like(raw.ranges, 0.3))
    assert masked[0].tolist() == (np.abs(bearings) <= 2 * math.asin(0.05 / 0.6)).tolist()
    with pytest.raises(OptionError, match="nothing leads from frame laser to base_link"):
        lidarcli.detect(SAMPLES / "room.mcap", mask=_of_base(tmp_path))


def _of_base(folder: Path) -> Path:
    path = folder / "base.toml"
    path.write_text(CIRCLE + "frame = 'base_link'\n")
    return path


def test_a_drive_tells_the_robot_from_what_is_around(drive: Scene, log: Path) -> None:
    raw, own = drawn(drive, 150)
    found = learned(log)
    masked = columns(found.rules.masks, raw)
    # Beams that pass the edge of a post may end on it or behind it.
    assert set(np.flatnonzero(own > 0.7 * 150).tolist()) <= masked <= set(np.flatnonzero(own > 0.2 * 150).tolist())
    assert len(masked) > 20
    assert found.notes == (f"/scan: {len(masked)} beams at 0.26 to 0.55 m see the robot itself: masked",)
    [batch, *_] = lidarcli.read(log, mask="auto")
    on_body = simulate_sweep_arrays(drive, 150)[1] == len(drive.entities) - 1
    missed = on_body[: len(batch)] & (batch.status == Status.VALID)
    wrong = ~on_body[: len(batch)] & (batch.status == Status.MASKED)
    assert missed.sum() < 0.02 * on_body[: len(batch)].sum()
    assert wrong.sum() == 0


def test_what_is_learned_can_be_written_and_read(log: Path, tmp_path: Path) -> None:
    found = learned(log)
    path = tmp_path / "robot.toml"
    path.write_text(mask_text(found.learned, found.proposed))
    assert lidarcli.tables(log, mask=path).sweeps.equals(lidarcli.tables(log, mask="auto").sweeps)


def test_tables_tell_their_mask(log: Path, tmp_path: Path) -> None:
    from lidarcli.cli import run

    assert run(["-q", "detect", str(log), "--mask", "auto", "-o", str(tmp_path)]) == 0
    schema = pq.read_schema(tmp_path / "body.sweeps.parquet")
    assert b'"mask": "auto"' in schema.metadata[b"lidarcli.parameters"]
    assert b'"mask": {"mask": [{"sector": {"farthest"' in schema.metadata[b"lidarcli.source"]
    page = tmp_path / "report.html"
    told = tmp_path / "report.json"
    words = ["-q", "report", tmp_path / "body.objects.parquet", "--log", log, "-o", page, "-o", told]
    assert run(list(map(str, words))) == 0
    assert 0.04 < json.loads(told.read_text())["figures"]["masked_share"] < 0.08


def test_a_parked_robot_is_proposed_and_not_masked(drive: Scene, tmp_path: Path) -> None:
    scene = with_body(replace(drive, path=PARKED, entities=drive.entities[:1], odometry=None))
    raw, own = drawn(scene, 60)
    path = tmp_path / "parked.mcap"
    write_mcap(path, [raw], poses=None)
    found = learned(path)
    assert found.rules.masks is None
    assert found.learned == Masks()
    near = np.flatnonzero((own > 30) & (np.nanmedian(raw.ranges, axis=0) < 0.4))
    assert columns(found.proposed, raw) == set(near.tolist())
    assert len(found.notes) == 2
    assert f"{len(near)} beams at 0.26 to 0.35 m look like the robot itself: --mask FILE" in found.notes[1]
    commented = mask_text(found.learned, found.proposed).splitlines()
    assert all(line.startswith("#") for line in commented if line)
    tables = [line.removeprefix("# ") for line in commented if "[[" in line or "=" in line]
    (tmp_path / "robot.toml").write_text("\n".join(tables))
    assert len(read_masks(str(tmp_path / "robot.toml")).masks) == len(found.proposed.masks)


def test_poses_of_another_robot_mask_no_furniture(tmp_path: Path) -> None:
    # A wall beside a parked sensor, whose log has the poses of something that drives.
    scene = load_scene(SAMPLES / "drive.toml")
    poses = simulate_odometry(scene, 150)
    ranges = np.random.default_rng(1).normal(3.0, 0.01, (150, 361)).astype(np.float32)
    ranges[:, 100:140] = 0.8
    raw = replace(simulate_sweep_arrays(scene, 150)[0], ranges=ranges)
    path = tmp_path / "other.mcap"
    write_mcap(path, [raw], poses=poses)
    found = learned(path)
    assert found.rules.masks is None
    assert found.notes[0].startswith("/scan: nothing is masked: nothing tells whether the sensor drove")


def test_a_sweep_of_other_beams_is_told_by_its_bearings(drive: Scene, tmp_path: Path) -> None:
    raw, own = drawn(drive, 150)
    # Every third sweep begins a beam later.
    later = np.arange(150) % 3 == 2
    ranges = raw.ranges.copy()
    ranges[later, :-1] = ranges[later, 1:]
    shifted = replace(
        raw,
        ranges=ranges,
        beams=np.where(later, 360, 361).astype(np.int32),
        angle_min=np.where(later, raw.angle_min + raw.angle_increment, raw.angle_min),
    )
    path = tmp_path / "shifted.mcap"
    write_mcap(path, [shifted], poses=simulate_odometry(drive, 150))
    assert columns(learned(path).rules.masks, raw) >= set(np.flatnonzero(own > 0.7 * 150).tolist())


def test_a_pipe_is_refused() -> None:
    log = FakeLog([raw_sweeps(np.full((4, 8), 1.0))], size=None)
    with pytest.raises(OptionError) as caught:
        masking_of(log, AUTO)
    assert str(caught.value) == (
        "--mask auto reads a log twice, and a pipe is read only once: give the file's name, or a mask FILE"
    )


@needs_real_logs
@pytest.mark.slow
def test_a_real_robot_with_three_lasers() -> None:
    found = learned(REAL_LOGS / "leg_tracker" / "negative_2.bag")
    beams: dict[str, int] = {}
    for batch in lidarcli.read(REAL_LOGS / "leg_tracker" / "negative_2.bag", mask="auto", pose="none"):
        always = np.count_nonzero(batch.status == Status.MASKED, axis=0) >= 0.3 * len(batch)
        beams[batch.topic] = int(np.count_nonzero(always))
        # All are at the edges of the view, where the laser looks back at its robot.
        assert set(np.flatnonzero((batch.status == Status.MASKED).any(axis=0))) <= {*range(40), *range(740, 768)}
    # Which sweeps count depends on the matched way.
    assert beams.keys() == {"/left_scan", "/rear_scan", "/right_scan"}
    assert [beams[topic] for topic in sorted(beams)] == pytest.approx([29, 57, 27], abs=2)
    assert all("see the robot itself: masked" in note for note in found.notes)


@needs_real_logs
@pytest.mark.slow
@pytest.mark.parametrize("name", ["sick/rms_1xxx_lms_1xx_movement_off.bag", "obstacle_detector/scans_demo.bag"])
def test_a_real_sensor_that_stood_masks_nothing(name: str) -> None:
    assert learned(REAL_LOGS / name).rules.masks is None


def test_names_of_any_letters_come_back_from_a_file(tmp_path: Path) -> None:
    name = 'a"\\\n\x7f\x1b]\U0001f600\u202e = 1'
    masks = Masks((Mask(Circle(0.0, 0.0, 0.5), topic=name, frame=name),), (Mount(name, "base", 0.0, 0.0, 0.0),))
    (tmp_path / "robot.toml").write_text(mask_text(masks, Masks()))
    read = read_masks(str(tmp_path / "robot.toml"))
    assert (read.masks[0].topic, read.mounts[0].frame) == (name, name)
