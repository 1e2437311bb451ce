"""Which files `--join` takes for parts of one recording, and what their log is called."""

from __future__ import annotations

from pathlib import Path

import pytest

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.pipeline.inputs.search import choose, files_of, find_logs, one_log, refuse_clashes
from lidarcli.pipeline.inputs.sources import MissingInput, Source


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def touch(*names: str) -> None:
    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(b"x" * len(name))


def told(found: list[Source | MissingInput]) -> dict[str, list[str]]:
    """Name of each log → its files."""
    sources = [source for source in found if isinstance(source, Source)]
    assert len(sources) == len(found)
    return {source.name: [part.path for part in source.parts] or [source.path] for source in sources}


@pytest.mark.parametrize(
    ("files", "logs"),
    [
        (
            ["b/run_10.bag", "b/run_0.bag", "b/run_2.bag", "b/hall.bag"],
            {"hall": ["b/hall.bag"], "run": ["b/run_0.bag", "b/run_2.bag", "b/run_10.bag"]},
        ),
        (
            ["b/x/run_0.mcap", "b/x/run_1.mcap", "b/y/run_0.mcap", "b/y/run_1.mcap"],
            {"x/run": ["b/x/run_0.mcap", "b/x/run_1.mcap"], "y/run": ["b/y/run_0.mcap", "b/y/run_1.mcap"]},
        ),
        # The same recording, converted.
        (
            ["b/run_0.bag", "b/run_1.bag.active", "b/run_0.mcap"],
            {"run": ["b/run_0.bag", "b/run_1.bag.active"], "run_0": ["b/run_0.mcap"]},
        ),
        # Two recordings of one prefix, as rosbag names them.
        (
            [
                "b/hall_2024-01-01-10-00-00_0.bag",
                "b/hall_2024-01-01-10-05-00_1.bag",
                "b/hall_2024-01-02-09-00-00_0.bag",
                "b/hall_2024-01-02-09-05-00_1.bag",
            ],
            {
                "hall_2024-01-01-10-00-00": ["b/hall_2024-01-01-10-00-00_0.bag", "b/hall_2024-01-01-10-05-00_1.bag"],
                "hall_2024-01-02-09-00-00": ["b/hall_2024-01-02-09-00-00_0.bag", "b/hall_2024-01-02-09-05-00_1.bag"],
            },
        ),
        (
            ["b/2024-01-01-10-00-00_0.bag", "b/2024-01-01-10-05-00_1.bag"],
            {"2024-01-01-10-00-00": ["b/2024-01-01-10-00-00_0.bag", "b/2024-01-01-10-05-00_1.bag"]},
        ),
        # Robots, days and CSV files of several topics are numbered as well.
        (
            ["b/robot_1.bag", "b/robot_2.bag", "b/run_2024_01_10.bag", "b/run_2024_01_11.bag", "b/s_0.csv", "b/s_1.csv"],
            {
                name: [f"b/{name}.{suffix}"]
                for name, suffix in (
                    ("robot_1", "bag"),
                    ("robot_2", "bag"),
                    ("run_2024_01_10", "bag"),
                    ("run_2024_01_11", "bag"),
                    ("s_0", "csv"),
                    ("s_1", "csv"),
                )
            },
        ),
    ],
)
def test_parts_below_a_folder(files: list[str], logs: dict[str, list[str]], folder: Path) -> None:
    touch(*files)
    assert told(find_logs(["b"], join=True)) == logs
    pattern = find_logs([f"{folder}/b/**/*.*"], join=True)
    assert sorted(told(pattern)) == sorted(logs)
    assert len(find_logs(["b"])) == len(files)


def test_a_list_is_as_a_folder(folder: Path) -> None:
    touch("b/x/run_0.bag", "b/x/run_1.bag", "b/y/run_0.bag", "b/y/run_1.bag", "list.txt")
    Path("list.txt").write_text("b/y/run_1.bag\nb/x/run_0.bag\nb/y/run_0.bag\nb/x/run_1.bag\nb/none.bag\n")
    *found, missing = choose([], "list.txt", "b", join=True)
    assert told(found) == {"y/run": ["b/y/run_0.bag", "b/y/run_1.bag"], "x/run": ["b/x/run_0.bag", "b/x/run_1.bag"]}
    assert missing.label == "list.txt: line 5: b/none.bag"
    shares = [choose(["b"], shard=(number, 2), join=True) for number in (1, 2)]
    assert sorted(name for share in shares for name in told(share)) == ["x/run", "y/run"]


@pytest.mark.parametrize(
    ("named", "name", "first"),
    [
        (["run_1.bag", "run_0.bag"], "run", "run_0.bag"),
        (["run_2.bag", "run_1.bag"], "run", "run_1.bag"),
        (["noon.bag", "morning.mcap"], "morning", "morning.mcap"),
        (["run_0.bag", "hall.bag"], "hall", "hall.bag"),
        (["b/run_0.bag", "a/run_1.bag"], "run", "a/run_1.bag"),
        (["run_10.csv", "run_9.csv"], "run", "run_9.csv"),
    ],
)
def test_all_that_are_named_are_one_log(named: list[str], name: str, first: str, folder: Path) -> None:
    touch(*named)
    (source,) = find_logs(named, join=True)
    assert isinstance(source, Source)
    assert (source.name, source.path, source.label) == (name, first, f"{first} and 1 more")
    assert source.size == sum(len(each) for each in named)
    assert sorted(files_of([source])) == sorted(named)


def test_one_that_is_named_is_read_as_ever(folder: Path) -> None:
    touch("run_0.bag")
    assert find_logs(["run_0.bag"], join=True) == find_logs(["run_0.bag"])


def test_folders_beside_what_is_named_are_logs_of_their_own(folder: Path) -> None:
    touch("a_0.bag", "b_0.bag", "c/run_0.bag", "c/run_1.bag")
    assert told(find_logs(["a_0.bag", "c", "b_0.bag"], join=True)) == {
        "a_0": ["a_0.bag", "b_0.bag"],
        "run": ["c/run_0.bag", "c/run_1.bag"],
    }


def test_what_is_named_has_to_be_there(folder: Path) -> None:
    touch("run_0.bag")
    (absent,) = find_logs(["run_0.bag", "run_1.bag"], join=True)
    assert isinstance(absent, MissingInput)
    assert (absent.path, str(absent.error)) == ("run_1.bag", "no such file or folder")


def test_a_part_is_named_once(folder: Path) -> None:
    touch("run_0.bag")
    Path("again.bag").symlink_to("run_0.bag")
    for again in ("run_0.bag", "./run_0.bag", "again.bag"):
        with pytest.raises(OptionError, match=f"^--join: {again} is named twice$"):
            find_logs(["run_0.bag", again], join=True)


def test_standard_input_is_no_part(folder: Path) -> None:
    touch("run_0.bag")
    with pytest.raises(OptionError, match=r"give the name of a file instead of -$"):
        find_logs(["-", "run_0.bag"], join=True)


def test_outputs_of_one_name_are_refused(folder: Path) -> None:
    touch("a/run_0.bag", "a/run_1.bag", "run.bag")
    with pytest.raises(OptionError, match=r"^run\.bag and a/run_0\.bag and 1 more would both write run\.\*"):
        refuse_clashes(find_logs(["run.bag", "a"], join=True))


def test_notes_on_what_looks_like_parts(folder: Path) -> None:
    touch("run_0.bag", "run_1.bag", "run_2.bag", *(f"b/{name}_{k}.mcap" for name in "pqrs" for k in (0, 1)))
    notes: list[str] = []
    choose(["run_0.bag", "run_1.bag", "run_2.bag"], note=notes.append)
    choose(["b"], note=notes.append, shard=(1, 1000))
    look = "look like parts of one recording: --join reads them as one log"
    assert notes == [
        f"run_0.bag and 2 more {look}",
        f"b/p_0.mcap and 1 more {look}",
        f"b/q_0.mcap and 1 more {look}",
        f"b/r_0.mcap and 1 more {look}",
        "so do the files of 1 more recording",
    ]
    notes.clear()
    choose(["b"], join=True, note=notes.append)
    choose(["run_0.bag"], note=notes.append)
    assert notes == []


def test_one_log_may_have_several_names(folder: Path) -> None:
    touch("b/run_0.bag", "b/run_1.bag", "c/x.bag", "c/y.bag")
    assert one_log(["b"], join=True).name == "run"
    assert one_log(["b/run_0.bag", "b/run_1.bag"], join=True).name == "run"
    for names, words in (
        (["b/run_0.bag", "b/run_1.bag"], "name one log; --join reads parts of one recording as one log"),
        (["b"], "holds 2 logs; name one of them, or read those of one recording as one by --join"),
        (["c"], "holds 2 logs; name one of them"),
    ):
        with pytest.raises(OptionError, match=f"{words}$"):
            one_log(names)
    with pytest.raises(UnreadableError, match=r"^b/run_2\.bag: no such file or folder$"):
        one_log(["b/run_0.bag", "b/run_2.bag"], join=True)
