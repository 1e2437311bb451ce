"""What a map judges is the path that the robot believed: its localisation, where it was told and as far as it was seen."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.simulation.writers import ROS1_BYTES, Outgoing, outgoing
from lidarcli.sweeps.types import Bool, Float64
from tests.pipeline.drawn import SWEEPS, driven, round_about, stamps, told, write, write_messages
from tests.pose.pose_messages import WITH_COVARIANCE, Maker

Run = Callable[..., Any]
SECONDS = np.arange(SWEEPS) * 0.1
NEVER = np.zeros(SWEEPS, bool)


def localised(
    path: Path, seen: Float64, *, amcl: bool = False, ends: int = SWEEPS, dark: Bool = NEVER, every: int = 1
) -> Path:
    """A log of odometry that is right, and of a localisation off by (S, 3) `seen`, as transforms or by a topic.

    It ends early; `dark` sweeps have no range, and the others have one for each so many beams.
    """
    sweeps = []
    for number, each in enumerate(driven()):
        ranges = each.ranges.copy()
        ranges[:, np.arange(ranges.shape[1]) % every > 0] = np.inf
        sweeps.append(replace(each, ranges=np.full_like(ranges, np.nan) if dark[number] else ranges))
    messages = list(outgoing(sweeps, told(round_about(SECONDS), tf=True), ROS1_BYTES))
    maker = Maker("ros1")
    for number, (stamp_ns, (dx, dy, turn)) in enumerate(zip(stamps().tolist(), seen.tolist(), strict=True)):
        if number < ends and amcl:
            x, y, yaw = round_about(SECONDS)[number]
            data = maker.pose(stamp_ns, "map", (x + dx, y + dy, yaw + turn), covariance=True)
            messages.append(Outgoing("/amcl_pose", WITH_COVARIANCE, stamp_ns, stamp_ns, data))
        elif number < ends:
            data = ROS1_BYTES.link(stamp_ns, "map", "odom", (dx, dy, turn))
            messages.append(Outgoing("/tf", ROS1_BYTES.tf_type, stamp_ns, stamp_ns, data))
    return write_messages(path, sorted(messages, key=lambda each: each.record_ns))


def off(rows: Bool, dx: float, turn: float = 0.0) -> Float64:
    """(S, 3) errors of a localisation in some sweeps."""
    seen = np.zeros((SWEEPS, 3))
    seen[rows, 0], seen[rows, 2] = dx, turn
    return seen


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of the room by its odometry."""
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("site")
    log = write(folder / "map.bag", told(round_about(SECONDS), tf=True))
    assert run(["-q", "map", str(log), "-o", str(folder / "site.yaml")]) == 0
    return folder / "site.yaml"


def figures(ran: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(ran.out)["logs"][0]["map"]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("amcl", [False, True])
@pytest.mark.parametrize(("dx", "turn"), [(0.5, 0.0), (2.0, 0.0), (0.0, 0.35)])
def test_a_localisation_that_jumps_is_lost_though_the_odometry_is_right(
    lidarcli: Run, site: Path, tmp_path: Path, dx: float, turn: float, amcl: bool
) -> None:
    log = localised(tmp_path / "run.bag", off(SECONDS >= 12.0, dx, turn), amcl=amcl)
    words = ("poses", log, "--map", site, "--check", "lost == 0")
    ran = lidarcli(*words, "--format", "json")
    assert ran.code == 1
    assert figures(ran)["lost"] == 1
    assert figures(ran)["lost_seconds"] == pytest.approx(8.0, abs=0.6)
    ran = lidarcli(*words)
    assert " from 12.0 to 20.0 s" in ran.err
    source = "/amcl_pose (map > base_link > laser)" if amcl else "/tf (map > odom > base_link > laser)"
    assert f"the path is that of {source}" in ran.err
    found = json.loads(lidarcli("info", log, "--map", site, "--format", "json").out)[0]["findings"]
    assert "lost" in {each["id"] for each in found}


@pytest.mark.slow
def test_a_slide_has_its_time_and_its_greatest_size(lidarcli: Run, site: Path, tmp_path: Path) -> None:
    seen = np.zeros((SWEEPS, 3))
    seen[:, 0] = np.clip((SECONDS - 8.0) / 6.0, 0.0, 1.0)
    log = localised(tmp_path / "run.bag", seen)
    ran = lidarcli("poses", log, "--map", site, "--format", "json")
    assert figures(ran)["off_max"] == pytest.approx(1.0, abs=0.05)
    (words,) = json.loads(ran.out)["logs"][0]["verdict"]
    assert "; off from 9.0 to 20.0 s, by up to 1." in words


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "every"), [(1.4, 3.0), (0.8, 4.0), (1.0, 20.0)])
def test_short_losses_count(lidarcli: Run, site: Path, tmp_path: Path, seconds: float, every: float) -> None:
    log = localised(tmp_path / "run.bag", off((SECONDS - 1.5) % every < seconds, 0.5))
    found = figures(lidarcli("poses", log, "--map", site, "--format", "json"))
    assert found["lost"] == np.ceil(18.5 / every)
    assert found["lost_seconds"] == pytest.approx(found["lost"] * seconds, rel=0.4)


@pytest.mark.slow
@pytest.mark.parametrize("ends", [True, False])
def test_a_check_of_a_path_that_was_not_judged_throughout_ends_with_3(
    lidarcli: Run, site: Path, tmp_path: Path, ends: bool
) -> None:
    """The localisation ends after a third, or the sweeps have no range then."""
    dark = NEVER if ends else SECONDS >= 7.0
    log = localised(tmp_path / "run.bag", off(SECONDS >= 7.0, 0.5), ends=70 if ends else SWEEPS, dark=dark)
    words = ("poses", log, "--map", site)
    ran = lidarcli(*words, "--check", "lost == 0")
    assert ran.code == 3
    assert "incomplete: the path of /scan was judged in 7" in ran.err
    assert "--check 'observed >= 0.35" in ran.err
    assert lidarcli(*words, "--check", "lost == 0", "--check", "observed >= 0.35").code == 0
    assert lidarcli("info", log, "--map", site, "--check", "findings.lost == 0").code == 1


@pytest.mark.slow
def test_no_verdict_by_a_few_beams(lidarcli: Run, site: Path, tmp_path: Path) -> None:
    log = localised(tmp_path / "run.bag", off(SECONDS >= 7.0, 0.5), every=30)
    ran = lidarcli("poses", log, "--map", site, "-o", tmp_path / "path.png")
    assert ran.code == 3
    assert "no part of the path can be judged" in ran.err
    assert lidarcli("poses", log, "--map", site, "--check", "lost == 0").code == 1
    assert "the path is that of" in ran.err
    assert (tmp_path / "path.png").exists()


@pytest.mark.slow
def test_nothing_is_judged_without_poses(lidarcli: Run, site: Path, tmp_path: Path) -> None:
    log = write(tmp_path / "run.bag", None)
    ran = lidarcli("poses", log, "--map", site, "--check", "lost == 0")
    assert ran.code == 3
    assert "--pose match" in ran.err
    assert lidarcli("info", log, "--map", site, "--check", "findings.lost == 0").code == 1


@pytest.mark.slow
def test_diff_tells_whose_path_it_compares(lidarcli: Run, site: Path, tmp_path: Path) -> None:
    ran = lidarcli("diff", site, localised(tmp_path / "run.bag", off(SECONDS >= 12.0, 2.0)), "--align", "auto")
    assert ran.code == 0
    assert "by the robot's own localisation the map explains" in ran.err
    assert "from 12.0 to 20.0 s" in ran.err
    assert "compared is another path" in ran.err
    ran = lidarcli("diff", site, localised(tmp_path / "right.bag", off(NEVER, 0.0)))
    assert "localisation" not in ran.err
