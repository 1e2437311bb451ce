"""Which logs are meant by files, folders, patterns and `-`."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import pytest

from lidarcli.pipeline.inputs.search import choose, find_logs, log_name
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.inspecting import inspect_log
from tests.pipeline.folders import logs_apart
from tests.sweeping import room_sweeps
from tests.text_logs import write_log
from tests.unprivileged import lidarcli as lidarcli_command


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("run.mcap", "run"),
        ("RUN.MCAP", "RUN"),
        ("b.db3.zstd", "b"),
        ("noext", "noext"),
        (".mcap", ".mcap"),
        ("scan.log", "scan"),
    ],
)
def test_log_names(name: str, expected: str) -> None:
    assert log_name(Path(name)) == expected


def test_folders_are_searched_and_logs_keep_their_place(tmp_path: Path) -> None:
    for name in ("b.mcap", "sub/a.bag", "sub/deep/c.CSV", "sub/readme.md", "sub/x.bag.active", "._b.mcap", ".trash/d.bag"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    bag = tmp_path / "sub" / "trip"
    bag.mkdir()
    for name in ("metadata.yaml", "trip_0.db3", "trip_1.db3", "scan.csv"):
        (bag / name).touch()
    (tmp_path / "sub" / "loop").symlink_to(tmp_path)
    os.mkfifo(tmp_path / "pipe.mcap")
    found = find_logs([str(tmp_path)])
    assert [source.name for source in found if isinstance(source, Source)] == [
        "b",
        "sub/a",
        "sub/deep/c",
        "sub/trip",
        "sub/x",
    ]
    assert found[3] == Source(str(bag), "sub/trip")


def test_a_bag_that_lost_its_metadata_is_one_log_but_loose_files_are_not(tmp_path: Path) -> None:
    lost, loose = tmp_path / "lost", tmp_path / "loose"
    lost.mkdir()
    loose.mkdir()
    for path in (lost / "run_0.db3", lost / "run_1.db3", loose / "a_0.db3", loose / "b_0.db3"):
        path.touch()
    assert [source.label for source in find_logs([str(lost)])] == [str(lost)]
    assert [Path(source.label).name for source in find_logs([str(loose)])] == ["a_0.db3", "b_0.db3"]


def test_files_with_one_sweep_each_are_one_log(tmp_path: Path) -> None:
    folder = tmp_path / "sweeps"
    folder.mkdir()
    text = "theta,r\n" + "".join(f"{k / 100},2.5\n" for k in range(100))
    for k in range(3):
        (folder / f"sweep_{k}.csv").write_text(text)
    (folder / "README.md").write_text("How these were made.\n")
    assert find_logs([str(tmp_path)]) == [Source(str(folder), "sweeps")]
    assert find_logs([str(folder)]) == [Source(str(folder), "sweeps")]
    pattern = str(folder / "*.csv")
    (source,) = find_logs([pattern])
    assert source == Source(pattern, "sweeps", tuple(str(folder / f"sweep_{k}.csv") for k in range(3)))
    assert inspect_log(source).scans[0].sweeps == 3
    assert inspect_log(Source(str(folder), "sweeps")).scans[0].sweeps == 3


def test_what_is_no_log(tmp_path: Path) -> None:
    (tmp_path / "dangling.mcap").symlink_to("nowhere")
    inputs = [str(tmp_path / "absent.mcap"), str(tmp_path / "dangling.mcap"), str(tmp_path)]
    (tmp_path / "empty").mkdir()
    inputs[2] = str(tmp_path / "empty")
    errors = [str(source.error) for source in find_logs(inputs) if isinstance(source, MissingInput)]
    assert errors == [
        "no such file or folder",
        "no such file or folder",
        "no log in this folder (searched for *.mcap *.bag *.active *.db3 *.zstd "
        "*.clf *.gfs *.clf.gz *.gfs.gz *.csv *.csv.gz)",
    ]


def test_standard_input_is_a_log() -> None:
    assert find_logs(["-"]) == [Source("-", "stdin")]
    assert Source("-", "stdin").label == "standard input"


@pytest.mark.slow
def test_what_may_not_be_looked_into_is_told(tmp_path: Path) -> None:
    folder = logs_apart(tmp_path / "logs")
    # Not a folder of its own name, so that its order among the logs shows.
    shut = folder / "deep"
    for mode in (0o000, 0o400):
        shut.chmod(mode)
        code, err = lidarcli_command("-q", "detect", folder, "-o", tmp_path / "out", "--overwrite")
        assert (code, err) == (3, f"lidarcli: {shut}: cannot be searched: Permission denied\n")
        assert sorted(path.name for path in (tmp_path / "out").glob("*.sweeps.parquet")) == [
            "drive.sweeps.parquet",
            "run 1.sweeps.parquet",
        ]
        assert lidarcli_command("-q", "info", folder)[0] == 3
        assert lidarcli_command("-q", "info", shut / "c.bag")[0] == 3
    shut.chmod(0o700)
    (folder / "drive.db3").chmod(0)
    code, err = lidarcli_command("-q", "info", folder / "drive.db3")
    assert (code, err) == (3, f"lidarcli: {folder}/drive.db3: cannot be opened: Permission denied\n")
    folder.chmod(0)
    assert lidarcli_command("-q", "info", folder) == (3, f"lidarcli: {folder}: cannot be searched: Permission denied\n")
    folder.chmod(0o700)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [0o000, 0o444])
def test_what_a_pattern_may_not_enter_is_told(tmp_path: Path, mode: int) -> None:
    for name in ("open", "shut", "other"):
        (tmp_path / name).mkdir()
        write_log(tmp_path / name / f"{name}.mcap", [room_sweeps(count=2)])
    shut = tmp_path / "shut"
    shut.chmod(mode)
    try:
        for pattern in ("**/*.mcap", "*/*.mcap", "[so]*/*.mcap"):
            out = tmp_path / f"out{len(list(tmp_path.iterdir()))}"
            code, err = lidarcli_command("detect", f"{tmp_path}/{pattern}", "-o", out)
            assert code == 3, pattern
            refused = [line for line in err.splitlines() if line.startswith("lidarcli: ")]
            assert len(refused) == 1
            assert refused[0].startswith(f"lidarcli: {shut}")
            assert refused[0].endswith("Permission denied")
            tables = sorted(path.name for path in out.rglob("*.objects.parquet"))
            assert tables == ["open.objects.parquet", "other.objects.parquet"]
        assert lidarcli_command("detect", f"{tmp_path}/o*/*.mcap", "-o", tmp_path / "out")[0] == 0
    finally:
        shut.chmod(0o755)


def test_a_pattern_names_what_a_shell_would(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a/b/x.bag", "a/.b/x.bag", "a/.x.bag", "c/x.bag", "c/[x].bag", "c/x.bag.gz", "x.bag", "a/note.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "c" / "self").symlink_to("self")
    (tmp_path / "a" / "again").symlink_to(tmp_path, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    searched = ["a/b/x.bag", "c/[x].bag", "c/x.bag", "x.bag"]
    for pattern, paths in {
        "*.bag": ["x.bag"],
        "*/x.bag": ["c/x.bag"],
        "**/x.bag": ["a/b/x.bag", "c/x.bag", "x.bag"],
        "**": searched,
        "[a-c]": searched[:3],
        "*/b": ["a/b/x.bag"],
        "*/.b/x.bag": ["a/.b/x.bag"],
        "a/.*.bag": ["a/.x.bag"],
        "c/[[]x].bag": ["c/[x].bag"],
        "**/b/**/x.bag": ["a/b/x.bag"],
        "a/n*": ["a/note.md"],
    }.items():
        for base in ("", f"{tmp_path}/"):
            found = find_logs([f"{base}{pattern}"])
            assert [source.path for source in found] == [f"{base}{path}" for path in paths], pattern
            assert all(isinstance(source, Source) for source in found)
    for pattern in ("none/*", "*/*/*/*.bag", "*/x.bag/y"):
        (absent,) = find_logs([pattern])
        assert isinstance(absent, MissingInput)
    assert [source.name for source in find_logs(["[a]/*"]) if isinstance(source, Source)] == ["a/b/x", "a/note"]


def test_logs_that_a_search_leaves_out_are_named(tmp_path: Path) -> None:
    sweeps = room_sweeps()
    for name in ("a.log", "sub/b.log", "c.jsonl", "d.mcap", ".old/e.mcap", "bag/deep/f.bag"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        write_log(tmp_path / name, [sweeps])
    write_log(tmp_path / "bag" / "bag_0.db3", [sweeps])
    (tmp_path / "a.log.gz").write_bytes(gzip.compress((tmp_path / "a.log").read_bytes(), mtime=0))
    for name in ("README.txt", "picture.png", ".hidden.txt", "._d.mcap"):
        (tmp_path / name).write_text("No log.\n")
    told: list[str] = []
    found = choose([str(tmp_path)], note=told.append)
    assert [source.name for source in found if isinstance(source, Source)] == ["bag", "d"]
    assert told == ["1 file *.jsonl, 2 files *.log, 1 file *.log.gz were not looked at: name them"]
