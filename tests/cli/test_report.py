"""`lidarcli report`: figures, checks and formats on the command line."""

from __future__ import annotations

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism.detection import SHAPES
from lidarcli.reports.programs import command
from tests import unprivileged
from tests.places import SAMPLES
from tests.reports.runs import START, TENTH, crossing, sweep, thing, write_run

Run = Callable[..., Any]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The tables of a run of 20 sweeps with two objects each; the second is gone after half of them."""
    counts = [2 if k < 10 else 1 for k in range(20)]
    objects = [thing(k, n + 1, width=0.3 + 0.2 * n) for k, count in enumerate(counts) for n in range(count)]
    return write_run(tmp_path / "run", [sweep(k, count) for k, count in enumerate(counts)], objects)


def test_either_table_names_the_pair_and_folders_are_searched(lidarcli: Run, run: Path) -> None:
    sweeps = run.with_name("run.sweeps.parquet")
    wanted = lidarcli("report", run, "--format", "json").out
    for inputs in ([sweeps], [run.parent], [f"{run.parent}/*.parquet"], [run, sweeps, run.parent]):
        assert lidarcli("report", *inputs, "--format", "json").out == wanted


def test_checks_decide_the_exit_code(lidarcli: Run, run: Path) -> None:
    assert lidarcli("report", run, "--check", "sweeps >= 20").code == 0
    ran = lidarcli("report", run, "--check", "sweeps >= 20", "--check", "objects_per_sweep.max < 2", code=1)
    assert ran.out.startswith(
        "Checks: 1 of 2 failed\nok    sweeps >= 20  (found 20)\nFAIL  objects_per_sweep.max < 2  (found 2)\n"
    )
    assert ran.err == ("lidarcli: check failed: objects_per_sweep.max is 2, expected < 2\n")


@pytest.mark.parametrize("odd", ["\x01", "\udcff", "]]>", "<&\x1b2J", "\ufffe", "\t"])
def test_junit_is_well_formed_whatever_the_texts(lidarcli: Run, tmp_path: Path, odd: str) -> None:
    run = write_run(tmp_path, [sweep(0, log=odd.encode("utf-8", "replace").decode())])
    check = f"objects where topic == '{odd}' > 0"
    ran = lidarcli("report", run, f"{odd}.sweeps.parquet", "--check", check, "--format", "junit", code=3)
    shown = odd if odd in ("]]>", "\t") else odd.translate({ord(c): repr(c)[1:-1] for c in "\x01\udcff\x1b\ufffe"})
    suite = ET.fromstring(ran.out.encode()).find("testsuite")
    assert suite is not None
    cases = suite.findall("testcase")
    assert cases[2].get("name") == f"objects where topic == '{shown}' > 0"
    failure = cases[2].find("failure")
    assert failure is not None
    assert failure.text == f"objects where topic == '{shown}' > 0\nexpected > 0, found 0"
    error = cases[1].find("error")
    assert error is not None
    assert error.get("message") == f"{shown}.sweeps.parquet: no such file or folder"


def test_several_outputs_at_once(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    names = ["a.md", "b.json", "c.xml", "d.txt"]
    words = [word for name in names for word in ("-o", tmp_path / name)]
    ran = lidarcli("report", run, *words)
    assert (ran.code, ran.out) == (0, "")
    assert [line.split()[1] for line in ran.err.splitlines()] == [str(tmp_path / name) for name in names]
    assert lidarcli("report", run, *words).code == 5
    assert lidarcli("report", run, *words, "--overwrite").code == 0


def test_inputs_that_cannot_be_read(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.objects.parquet"
    bad.write_bytes(b"PAR1 is not enough")
    (tmp_path / "bad.sweeps.parquet").write_bytes(b"")
    foreign = tmp_path / "foreign.sweeps.parquet"
    pq.write_table(pq.read_table(run).select(["log"]), foreign)
    for name, why in (
        (tmp_path / "none.objects.parquet", "no such file or folder"),
        (tmp_path / "*.nothing", "no tables match this pattern"),
        (bad, "cannot be read as Parquet: "),
        (foreign, "not a table of lidarcli detect: no column agent_beams, agents, "),
        (__file__, "not a table of lidarcli detect (<log>.objects.parquet or <log>.sweeps.parquet)"),
    ):
        ran = lidarcli("report", name)
        assert (ran.code, ran.out) == (3, "")
        assert why in ran.err
        assert len(ran.err.splitlines()) == 1
    ran = lidarcli("report", bad, run, "--format", "json", code=3)
    assert json.loads(ran.out)["figures"]["sweeps"] == 20
    assert "bad.sweeps.parquet: cannot be read as Parquet" in json.loads(ran.out)["problems"][0]


def test_a_baseline_that_was_seen_in_part_passes_no_check_in_silence(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    """Half of yesterday's sweeps would make today twice as busy."""
    cut = write_run(tmp_path / "cut", [sweep(k, 1, log="cut") for k in range(9)], damage=["byte 99: cut"], name="cut")
    blind = write_run(tmp_path / "blind", [sweep(k, 1, observed=k > 9) for k in range(20)])
    for base, words, accepted in (
        (cut, "baseline cut: damaged when its tables were made", "damage <= 1"),
        (blind, "baseline run: 10 of 20 sweeps show anything", "observed >= 0.5"),
    ):
        gate = ("--baseline", base, "--check", "percent.objects >= -10", "--check", "percent.gaps == 0")
        ran = lidarcli("report", run, *gate, code=3)
        assert words in ran.err
        assert lidarcli("report", run, *gate, "--check", accepted).code == 0
        assert lidarcli("report", run, "--baseline", base, "--check", "sweeps == 20").code == 0


def test_percent_of_nothing(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    """Of none nobody can tell how many percent more there are; as many as before are no more."""
    base = write_run(tmp_path / "base", [sweep(k) for k in range(20)])
    for mine, code, found in ((run, 1, None), (base, 0, 0)):
        ran = lidarcli("report", mine, "--baseline", base, "--check", "percent.objects <= 10", "--format", "json")
        assert (ran.code, json.loads(ran.out)["checks"][0]["found"]) == (code, found)


@pytest.mark.parametrize(
    ("expression", "parameter", "value"),
    [
        ("change.appeared", "background", {"file": "e.parquet"}),
        ("objects where change == appeared", "background", {"file": "e.parquet"}),
        ("objects where label == pallet", "catalogue", {"things": []}),
        ("objects where world_x > 1", None, {"world_x": 0.5}),
        ("objects where intensity > 100", None, {"intensity": 20.0}),
    ],
)
def test_what_nobody_looked_for_is_not_none(
    lidarcli: Run, tmp_path: Path, expression: str, parameter: str | None, value: dict[str, Any]
) -> None:
    """Without a background nothing has appeared, because nobody knows."""
    plain = write_run(tmp_path / "plain", [sweep(0, 1)], [thing(0, 1)])
    told = {} if parameter else value
    known = write_run(
        tmp_path / "known", [sweep(0, 1)], [thing(0, 1, **told)], parameters={parameter: value} if parameter else {}
    )
    for run, code, found in ((plain, 1, None), (known, 0, 0)):
        ran = lidarcli("report", run, "--check", f"{expression} == 0", "--format", "json")
        assert (ran.code, json.loads(ran.out)["checks"][0]["found"]) == (code, found)


def test_a_baseline(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    base = write_run(tmp_path / "base", [sweep(k, 2) for k in range(18)], [thing(k, 1) for k in range(18)])
    checks = ["delta.objects_per_sweep.mean between -0.5 and 0.5", "changed_sweeps == 8", "added_sweeps == 2"]
    words = [word for check in checks for word in ("--check", check)]
    ran = lidarcli("report", run, "--baseline", base, "--format", "json", *words)
    found = json.loads(ran.out)
    assert [check["found"] for check in found["checks"]] == [-0.5, 8, 2]
    assert ran.code == 0
    assert found["comparison"]["baseline"]["figures"]["sweeps"] == 18
    assert found["comparison"]["changes"][0] == {"log": "run", "topic": "/scan", "sweep": 10, "before": 2, "now": 1}
    text = lidarcli("report", run, "--baseline", base).out
    words = (
        "Sweeps in both runs: 18, 8 of them (44.4 %) with another number of objects; only here: 2; only in the baseline: 0"
    )
    assert words in " ".join(text.split())
    assert text.startswith("Compared with the baseline\n")
    assert text.index(words[:20]) < text.index("Overview")
    markdown = lidarcli("report", run, "--baseline", base, "--format", "markdown").out
    assert markdown.splitlines()[2] == "### Compared with the baseline"
    missing = lidarcli("report", run, "--baseline", tmp_path / "nothing")
    assert (missing.code, missing.out) == (3, "")


@pytest.fixture
def tracked(tmp_path: Path) -> Path:
    """The tables of `track`: a pallet, a person, a robot."""
    return write_run(tmp_path / "tracked", **crossing())


def test_tracks_of_other_objects_are_told(lidarcli: Run, run: Path, tracked: Path) -> None:
    stale = run.with_name("run.tracks.parquet")
    stale.write_bytes(tracked.with_name("run.tracks.parquet").read_bytes())
    ran = lidarcli("report", run, "--format", "json", "--check", "tracks >= 0", code=3)
    assert ran.err.splitlines()[0] == (
        f"lidarcli: {stale}: does not belong to run.objects.parquet, whose tracks are others; "
        "write both again with lidarcli track"
    )
    found = json.loads(ran.out)
    assert (found["figures"]["sweeps"], "tracks" in found, found["checks"][0]["found"]) == (20, False, None)
    table = pq.read_table(stale)
    pq.write_table(table.slice(1), tracked.with_name("run.tracks.parquet"))
    assert "whose tracks are others" in lidarcli("report", tracked).err
    pq.write_table(table.drop_columns(["end"]), tracked.with_name("run.tracks.parquet"))
    ran = lidarcli("report", tracked)
    assert (ran.code, "not a table of lidarcli track: no column end" in ran.err) == (3, True)


def test_objects_are_the_same_rows_after_detect_and_after_track(lidarcli: Run, tmp_path: Path) -> None:
    """A gate on objects sees agents, too: who walks by is nearest of all."""
    for finder in ("detect", "track"):
        assert lidarcli("-q", finder, SAMPLES / "people.csv.gz", "-o", tmp_path / finder).code == 0
    expressions = (
        "objects where r_min < 2.3 == 0",
        "range.min > 2.3",
        "objects_per_sweep.max <= 4",
        "sweeps where objects > 6 == 0",
        "object_share < 0.01",
        "shape.legged == 0",
        "objects > 0",
    )
    checks = [word for text in expressions for word in ("--check", text)]
    found = {}
    for finder in ("detect", "track"):
        ran = lidarcli("report", tmp_path / finder, "--format", "json", *checks, code=1)
        told = json.loads(ran.out)
        found[finder] = {one["check"]: one["found"] for one in told["checks"][:4]}
        sweeps = pq.read_table(tmp_path / finder / "people.sweeps.parquet")
        objects = pq.read_table(tmp_path / finder / "people.objects.parquet")
        per_sweep = np.add(*(sweeps[name].to_numpy() for name in ("objects", "agents")))
        assert told["figures"]["objects"] == objects.num_rows == per_sweep.sum()
        assert told["figures"]["range.min"] == pytest.approx(objects["r_min"].to_numpy().min())
        assert told["figures"]["objects_per_sweep.max"] == per_sweep.max()
        assert told["figures"]["agents"] == objects["set"].to_pylist().count("A")
        assert sum(told["figures"][f"shape.{shape}"] for shape in SHAPES if shape != "wall") == objects.num_rows
        near = (objects["r_min"].to_numpy() < 2.3).sum()
        assert told["checks"][0]["found"] == near > 0
    # Tracking tells agents apart; it takes away nothing that detection has found near.
    assert found["detect"][expressions[1]] == pytest.approx(found["track"][expressions[1]], abs=0.05)


def test_what_has_gone_is_no_object(lidarcli: Run, tmp_path: Path) -> None:
    rows = [
        thing(0, 1, change="appeared", difference=-1.0),
        thing(0, 2, change="removed", difference=1.0, r_min=0.3),
        thing(0, 3, set="S", shape="wall", r_min=0.2),
    ]
    run = write_run(tmp_path, [sweep(0, 1)], rows)
    wanted = {
        "objects == 1": 1,
        "objects where r_min > 0 == 1": 1,
        "objects where set == O == 1": 1,
        "objects where set == S == 1": 1,
        "objects where change == removed == 1": 1,
        "objects where change == appeared == 1": 1,
        "objects where set != S and change is not null == 2": 2,
        "range.min == 2": 2,
        "shape.prismatic == 1": 1,
        "change.removed == 1": 1,
        "change.appeared == 1": 1,
        "difference.max == -1": -1,
    }
    words = [word for check in wanted for word in ("--check", check)]
    ran = lidarcli("report", run, "--format", "json", *words)
    assert {one["check"]: one["found"] for one in json.loads(ran.out)["checks"]} == wanted
    assert ran.code == 0


def test_the_nearest_beam(lidarcli: Run, tmp_path: Path) -> None:
    near = {"nearest": 0.4, "nearest_theta": 1.0}
    rows = [sweep(0, 1, nearest=2.0, nearest_theta=0.0), sweep(1, 1, **near), sweep(2, 1)]
    run = write_run(tmp_path / "walls", rows, [thing(k, 1) for k in range(3)])
    ran = lidarcli("report", run, "--check", "nearest.min > 0.5", "--check", "range.min > 0.5", code=1)
    assert ran.out.startswith(
        "Checks: 1 of 2 failed\nFAIL  nearest.min > 0.5  (found 0.4)\nok    range.min > 0.5  (found 2)\n"
    )
    for check in ("sweeps where nearest < 0.5 == 1", "sweeps where nearest is null == 1", "nearest.max == 2"):
        assert lidarcli("report", run, "--check", check).code == 0


def test_checks_of_a_damaged_log_are_not_passed_in_silence(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    cut = write_run(tmp_path / "cut", [sweep(0, log="cut")], damage=["byte 99: cut", "byte 200: cut"], name="cut")
    line = "cut: damaged when its tables were made (byte 99: cut); --check 'damage <= 2' accepts that"
    ran = lidarcli("report", cut, run, "--check", "sweeps >= 1")
    assert (ran.code, ran.err) == (3, f"lidarcli: incomplete: {line}\n")
    start = f"incomplete: {line} Checks: 1 of 1 passed, on part of the data ok sweeps >= 1"
    assert " ".join(ran.out.split()).startswith(start)
    told = json.loads(lidarcli("report", cut, "--check", "sweeps >= 1", "--format", "json").out)
    assert (told["holds"], told["checks"][0]["holds"], told["problems"]) == (False, True, [line])
    told = lidarcli("report", cut, "--check", "sweeps >= 9", "--check", "sweeps >= 1", "--format", "markdown").out
    assert f"**Incomplete:** {line.replace('<', '&lt;')}" in told
    assert "**Checks: 1 of 2 failed, on part of the data.**" in told
    page = lidarcli("report", cut, "--check", "sweeps >= 1", "--format", "html").out
    assert "all hold, on part of the data" in page
    assert "Incomplete: cut: damaged" in page
    ran = lidarcli("report", cut, "--check", "sweeps >= 1", "--format", "junit")
    suite = ET.fromstring(ran.out)[0]
    assert (suite.get("failures"), suite.get("errors")) == ("0", "1")
    assert (
        f"::error title=lidarcli%3A incomplete::{line}"
        in lidarcli("report", cut, "--check", "sweeps >= 1", "--format", "github").out.splitlines()
    )
    for checks, code in (
        (("sweeps >= 1", "damage <= 2"), 0),
        (("sweeps >= 1", "damage <= 1"), 1),
        (("sweeps > 100",), 1),
        ((), 0),
    ):
        words = [word for check in checks for word in ("--check", check)]
        assert lidarcli("report", cut, *words).code == code
    words = ("--baseline", cut, "--check", "delta.damage == 0")
    assert lidarcli("report", cut, *words).code == 0


@pytest.mark.parametrize("table", ["objects", "sweeps"])
def test_a_log_without_one_of_its_tables_is_not_passed_over(lidarcli: Run, run: Path, tmp_path: Path, table: str) -> None:
    missing = run.with_name(f"b.{table}.parquet")
    write_run(run.parent, [sweep(0, 1, log="b")], [thing(0, 1, log="b")], name="b")
    missing.unlink()
    other = "sweeps" if table == "objects" else "objects"
    for named in (run.parent, f"{run.parent}/*.{other}.parquet", f"{run.parent}/*.parquet"):
        ran = lidarcli("report", named, "--check", "sweeps >= 1")
        line = f"{missing}: not there; lidarcli detect writes it"
        assert (ran.code, ran.err) == (3, f"lidarcli: {line}\n")
        assert "Checks: 1 of 1 passed, on part of the data" in ran.out
        told = json.loads(lidarcli("report", named, "--check", "sweeps >= 1", "--format", "json").out)
        assert (told["holds"], told["figures"]["logs"], told["problems"]) == (False, 1, [line])
    ran = lidarcli("report", run.parent, "--format", "json")
    assert (ran.code, json.loads(ran.out)["holds"]) == (3, False)


def test_of_another_recording_the_figures_alone_are_compared(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    later = [sweep(k, 1, stamp=START + 7 * TENTH * k + 5) for k in range(20)]
    other = write_run(tmp_path / "other", later, [thing(k, 1) for k in range(20)])
    beams = write_run(tmp_path / "beams", [sweep(k, 1, beams=200, noise_beams=195) for k in range(20)])
    topic = write_run(tmp_path / "topic", [sweep(k, 1, topic="/front") for k in range(20)])
    # Simulated runs may have the same stamps.
    unlike = write_run(tmp_path / "unlike", [sweep(k, 1) for k in range(20)], recording={"/scan": "20 1"})
    here = write_run(tmp_path / "here", [sweep(k, 2) for k in range(20)], recording={"/scan": "20 2"})
    for mine, base in ((run, other), (run, beams), (run, topic), (here, unlike)):
        ran = lidarcli(
            "report", mine, "--baseline", base, "--check", "percent.objects between -50 and 100", "--format", "json"
        )
        found = json.loads(ran.out)["comparison"]
        assert (ran.code, found["changes"], found["figures"]["compared_sweeps"]) == (0, [], None)
        assert found["figures"]["percent.objects"] == 100 * found["figures"]["delta.objects"] / 20
        assert "Two recordings" in lidarcli("report", mine, "--baseline", base).out
        judged = lidarcli("report", mine, "--baseline", base, "--check", "changed_sweeps == 0")
        assert (judged.code, "baseline: of another recording" in judged.err) == (1, True)
    same = write_run(tmp_path / "same", [sweep(k, 1) for k in range(20)], recording={"/scan": "20 2"})
    assert "Sweeps in both runs: 20, 20 of them" in " ".join(lidarcli("report", here, "--baseline", same).out.split())
    # Other programs write stamps in microseconds, and a mended log may have a few others.
    rewritten = [sweep(k, 2, stamp=START + TENTH * k + 999 + 10**9 * (k in (3, 4))) for k in range(20)]
    same = write_run(tmp_path / "same", rewritten)
    assert lidarcli("report", run, "--baseline", same).code == 0
    empty = write_run(tmp_path / "empty", [])
    assert lidarcli("report", run, "--baseline", empty).code == 0


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "named"), [(0o000, "{}"), (0o444, "{}/**/*.objects.parquet")])
def test_a_folder_that_nobody_may_enter_is_told(run: Path, mode: int, named: str) -> None:
    """The gate has not seen what lies below."""
    below = run.parent / "sub"
    below.mkdir()
    for table in ("objects", "sweeps"):
        run.with_name(f"run.{table}.parquet").rename(below / f"shut.{table}.parquet")
    write_run(run.parent, [sweep(0, 1)], [thing(0, 1)])
    below.chmod(mode)
    try:
        code, err = unprivileged.lidarcli("report", named.format(run.parent), "--check", "sweeps >= 1")
        assert (code, err.count("\n")) == (3, 1)
        assert err.startswith(f"lidarcli: {below}")
        assert "Permission denied" in err
    finally:
        below.chmod(0o755)


CHECKS = ("--check", "sweeps >= 20", "--check", "objects == 3")


@pytest.fixture
def plain_run(tmp_path: Path) -> Path:
    """The tables of a run of 20 sweeps with an object each."""
    rows = [sweep(k, 1) for k in range(20)]
    return write_run(tmp_path / "run", rows, [thing(k, 1) for k in range(20)])


@pytest.fixture
def baseline(tmp_path: Path) -> Path:
    """The same without objects in the first three sweeps, and without the last two."""
    rows = [sweep(k, int(k > 2)) for k in range(18)]
    return write_run(tmp_path / "base", rows, [thing(k, 1) for k in range(3, 18)])


@pytest.fixture
def unlike(tmp_path: Path) -> Path:
    """The tables of three logs: 5, 10 and 20 Hz, 100 and 360 beams, two frames."""
    for name, stride, other in (
        ("slow", 2, {}),
        ("usual", 1, {"beams": 360, "valid": 359, "noise_beams": 355}),
        ("fast", 0.5, {"frame_id": "front"}),
    ):
        sweeps = [sweep(k, 1, log=name, stamp=START + int(stride * TENTH) * k, **other) for k in range(len(name))]
        write_run(tmp_path / "unlike", sweeps, [thing(k, 1, log=name) for k in range(len(name))], name=name)
    return tmp_path / "unlike"


def test_brief_text(lidarcli: Run, plain_run: Path, baseline: Path) -> None:
    ran = lidarcli("report", plain_run, *CHECKS, "--brief", code=1)
    assert ran.out == (
        "Checks: 1 of 2 failed\n"
        "ok    sweeps >= 20  (found 20)\n"
        "FAIL  objects == 3  (found 20)\n"
        "\n"
        "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)\n"
    )
    ran = lidarcli("report", plain_run, "--baseline", baseline, "--brief", "--check", "changed_sweeps == 3")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == (
        "Checks: 1 of 1 passed\n"
        "ok    changed_sweeps == 3  (found 3)\n"
        "\n"
        "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)\n"
        "Sweeps in both runs: 18, 3 of them (16.7 %) with another number of objects; only\n"
        "here: 2; only in the baseline: 0\n"
    )
    assert lidarcli("report", plain_run, "--brief").out == "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)\n"


@pytest.mark.parametrize("kind", ["json", "junit", "html"])
def test_brief_is_not_for_programs(lidarcli: Run, plain_run: Path, tmp_path: Path, kind: str) -> None:
    out = tmp_path / "report.md"
    ran = lidarcli("report", plain_run, "--brief", "--format", kind, "-o", out)
    assert (ran.code, ran.out, out.exists()) == (2, "", False)
    assert f"--brief is for text, markdown, github; leave it out for {kind}" in ran.err


def test_github(lidarcli: Run, plain_run: Path, tmp_path: Path) -> None:
    ran = lidarcli("report", plain_run, tmp_path / "none.sweeps.parquet", *CHECKS, "--brief", "--format", "github")
    assert (ran.code, "no such file" in ran.err) == (3, False)
    assert ran.out.splitlines() == [
        f"::error title=lidarcli%3A not read::{tmp_path}/none.sweeps.parquet: no such file or folder",
        "::error title=lidarcli%3A check failed::objects == 3: expected == 3, found 20",
        "::notice title=lidarcli report::Checks: 1 of 2 failed, on part of the data%0A"
        "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)",
        "::notice title=lidarcli%3A check passed::sweeps >= 20: found 20",
    ]


def test_github_folds_the_report_where_no_name_of_a_log_is_a_command(lidarcli: Run, tmp_path: Path) -> None:
    run = write_run(tmp_path, [sweep(0, 1, log="::error::boo")], [thing(0, 1)], name="run")
    lines = lidarcli("report", run, "--format", "github").out.splitlines()
    assert lines[1] == "::group::::error::boo"
    assert lines[2].startswith("::stop-commands::")
    word = lines[2].removeprefix("::stop-commands::")
    assert lines[-2:] == [f"::{word}::", "::endgroup::"]
    text = "\n".join(lines[3:-2]) + "\n"
    assert text == lidarcli("report", run).out
    assert word == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("text", ["100 %", "a\nb", "a\r\nb", "%0A", "a:b,c", "::error::x"])
def test_what_github_reads_is_what_was_meant(text: str) -> None:
    line = command("notice", text, text)
    assert len(line.splitlines()) == 1
    _, properties, message = line.split("::", 2)
    assert unquote(message) == text
    kind, title = properties.split(" ", 1)
    assert (kind, unquote(title)) == ("notice", f"title={text}")
    assert not {":", ","} & set(title)


def test_unlike_sensors_are_told_and_not_pooled(lidarcli: Run, unlike: Path) -> None:
    warning = (
        "unlike sensors (5 to 20 Hz; 100 to 360 beams; frames front, laser): the figures pool all of them, and no map in "
        "the sensor frame is drawn; for figures of one sensor report its tables alone"
    )
    text = lidarcli("report", unlike).out
    assert max(map(len, text.splitlines())) <= 80
    assert " ".join(text.split()).startswith(f"warning: {warning} Run by run start log sweeps")
    lines = text.splitlines()
    start = lines.index("Logs")
    assert lines[start + 1 : start + 6] == [
        "log and topic  sweeps  duration   rate  beams  objects",
        "fast /scan          4    0.15 s  20 Hz    100        4",
        "slow /scan          4    0.60 s   5 Hz    100        4",
        "usual /scan         5    0.40 s  10 Hz    360        5",
        "formats  3 mcap; 3,000 bytes",
    ]
    assert "clock             5 to 20 Hz, no gaps, all stamps increasing" in text
    for words in ("Where objects were", "step [s]", "beams_per_object"):
        assert words not in text
    assert f"::warning title=lidarcli::{warning}\n" in lidarcli("report", unlike, "--format", "github").out
    markdown = lidarcli("report", unlike, "--format", "markdown").out
    assert markdown.splitlines()[2].startswith("**Warning:** unlike sensors (5 to 20 Hz; ")
    assert "| 5 to 20 Hz |" in markdown
    ran = lidarcli("report", unlike, "--format", "json")
    assert ran.err == f"warning: {warning}\n"
    found = json.loads(ran.out)
    suite = ET.fromstring(lidarcli("report", unlike, "--format", "junit").out.encode())[0]
    assert suite.findtext("system-out") == f"warning: {warning}"
    assert f"Warning: {warning}</p>" in lidarcli("report", unlike, "--format", "html").out
    assert (found["warnings"], found["maps"]) == ([warning], [])
    assert [stream["beams"] for stream in found["streams"]] == [100, 100, 360]
