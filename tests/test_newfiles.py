"""Outputs: whole or not there, whoever else writes or has planted something, and never in the place of an input."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pyarrow.csv
import pyarrow.ipc
import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from lidarcli.errors import OptionError, OutputError
from lidarcli.files import newfiles
from lidarcli.files.newfiles import NewFiles, refuse, refuse_lost, scratch_folder, write_whole
from lidarcli.tabular.writing import TableFiles
from tests.places import SAMPLES
from tests.unprivileged import lidarcli

ROOM = SAMPLES / "room.mcap"
SCENE = ROOM.with_suffix(".toml")


def said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().err.splitlines()


def test_files_appear_together_and_nothing_is_left(tmp_path: Path) -> None:
    paths = [tmp_path / "out" / name for name in ("a", "b")]
    with NewFiles(paths) as new:
        for path in paths:
            new.part(path).write_text(path.name)
        assert not any(path.exists() for path in paths)
        (scratch,) = (tmp_path / "out").iterdir()
        assert scratch.stat().st_mode & 0o777 == 0o700
        assert new.publish() == []
    assert {path.name: path.read_text() for path in (tmp_path / "out").iterdir()} == {"a": "a", "b": "b"}


def test_what_killed_runs_left_is_cleared_away_and_what_others_are_at_is_not(tmp_path: Path) -> None:
    mine = f".lidarcli-{newfiles._HOST}"
    dead = tmp_path / f"{mine}-0123456789abcdef.part"
    dead.mkdir()
    (dead / "table").write_text("half")
    keepsake = tmp_path / "keepsake"
    keepsake.mkdir()
    planted = tmp_path / f"{mine}-ffffffffffffffff.part"
    planted.symlink_to(keepsake)
    other_name, other_host = (tmp_path / ".lidarcli-mine.part", tmp_path / ".lidarcli-00000000-0123456789abcdef.part")
    for other in (other_name, other_host):
        other.mkdir()
    with NewFiles([tmp_path / "x"]) as one:
        one.part(tmp_path / "x").write_text("1")
        with NewFiles([tmp_path / "y"]) as two:
            two.part(tmp_path / "y").write_text("2")
            two.publish()
        one.publish()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        [planted.name, other_name.name, other_host.name, "keepsake", "x", "y"]
    )
    assert keepsake.is_dir()


def test_of_two_runs_at_once_the_last_one_wins_and_says_so(tmp_path: Path) -> None:
    paths = [tmp_path / "a", tmp_path / "b"]
    with NewFiles(paths) as first, NewFiles(paths) as second:
        for new, text in ((first, "first"), (second, "second")):
            for path in paths:
                new.part(path).write_text(text)
        assert first.publish() == []
        assert second.publish() == [f"replaced {path}, which another run has written meanwhile" for path in paths]
    assert [path.read_text() for path in paths] == ["second", "second"]


def test_without_overwrite_the_first_one_stays(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with NewFiles([path], overwrite=False) as first, NewFiles([path], overwrite=False) as second:
        first.part(path).write_text("first")
        second.part(path).write_text("second")
        first.publish()
        with pytest.raises(OutputError) as caught:
            second.publish()
    assert str(caught.value) == (f"{path} exists: another run has written it meanwhile; use --overwrite to replace it")
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_without_locks_is_written_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As some network file systems are."""
    monkeypatch.setattr(newfiles, "fcntl", None)
    assert write_whole(tmp_path / "a", b"1") == []
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [".run.objects.parquet.part", "room.objects.parquet"])
def test_no_planted_link_is_written_through(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    thesis = tmp_path / "thesis.tex"
    thesis.write_text("years of work")
    out = tmp_path / "out"
    out.mkdir()
    (out / name).symlink_to(thesis)
    # Somebody else's link of the final name is a file that exists.
    code = run(["-q", "detect", str(ROOM), "-o", str(out)])
    assert code == (0 if name.startswith(".") else 5)
    assert run(["-q", "detect", str(ROOM), "-o", str(out), "--overwrite"]) == 0
    assert run(["-q", "report", str(out), "-o", str(out / "r.html")]) == 0
    assert thesis.read_text() == "years of work"
    assert not (out / "room.objects.parquet").is_symlink()
    capsys.readouterr()


def inputs(folder: Path) -> Path:
    log = folder / "run.mcap"
    shutil.copy(ROOM, log)
    shutil.copy(SCENE, folder / "s.toml")
    assert run(["-q", "detect", str(log), "-o", str(folder)]) == 0
    assert run(["-q", "background", "build", str(log), "-o", str(folder / "e.parquet")]) == 0
    (folder / "linked.svg").symlink_to(log)
    os.link(log, folder / "hard.pdf")
    os.link(folder / "run.sweeps.parquet", folder / "hard.json")
    os.link(folder / "e.parquet", folder / "x.objects.parquet")
    shutil.copy(ROOM, folder / "x.mcap")
    return folder


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        ("background build run.mcap -o hard.pdf", "hard.pdf"),
        ("background build run.mcap -o linked.svg", "linked.svg"),
        ("background build run.mcap -o f.parquet --plot hard.pdf", "hard.pdf"),
        ("plot run.mcap -o linked.svg", "linked.svg"),
        ("plot run.mcap -o hard.pdf", "hard.pdf"),
        ("report run.objects.parquet -o hard.json", "hard.json"),
        ("report run.objects.parquet --log run.mcap -o hard.pdf --format html", "hard.pdf"),
        ("detect x.mcap --background e.parquet -o .", "x.objects.parquet"),
        ("detect x.mcap --background e.parquet -o e.parquet", "e.parquet"),
        ("simulate s.toml -o s.toml --container csv", "s.toml"),
    ],
)
def test_an_output_that_is_an_input_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: str, output: str
) -> None:
    folder = inputs(tmp_path)
    monkeypatch.chdir(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    capsys.readouterr()
    assert run(["-q", *arguments.split(), "--overwrite"]) == 5
    (line,) = said(capsys)
    assert f"{output} is an input of this run (" in line
    assert line.endswith("); write elsewhere with -o")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_every_file_that_an_option_names_is_an_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    texts = {"lidarcli.toml": "verbose = true\n", "other.toml": "", "logs.csv": "run.csv\n"}
    for name, text in texts.items():
        Path(name).write_text(text)
    shutil.copy(SCENE, "s.toml")
    for output, command in (
        ("lidarcli.toml", "simulate s.toml --container csv --config lidarcli.toml"),
        ("other.toml", "--config other.toml simulate s.toml --container csv"),
        ("logs.csv", "detect --files-from logs.csv"),
    ):
        assert run([*command.split(), "-o", output, "--overwrite"]) == 5
        assert f"{output} is an input of this run (" in capsys.readouterr().err
    assert {name: Path(name).read_text() for name in texts} == texts


def a_bag(folder: Path, *names: str, listed: str = "") -> Path:
    folder.mkdir(parents=True)
    for name in names:
        (folder / name).write_text(name)
    (folder / "metadata.yaml").write_text(f"relative_file_paths: [{listed or ', '.join(names)}]\n")
    return folder


def test_a_bag_replaces_a_folder_that_is_one_bag_or_empty(tmp_path: Path) -> None:
    whole, empty, log = a_bag(tmp_path / "bag", "a_0.db3", "a_1.db3"), tmp_path / "empty", tmp_path / "log"
    empty.mkdir()
    (tmp_path / "link").symlink_to(whole)
    log.write_text("read")
    for path in (empty, whole, tmp_path / "link"):
        refuse([path], overwrite=True, inputs=[log], bag=path)
        with pytest.raises(OutputError, match=" exists; use --overwrite"):
            refuse([path], overwrite=False, bag=path)
        with pytest.raises(OutputError, match="is a folder; it is not replaced"):
            refuse([path], overwrite=True)
    with NewFiles([tmp_path / "link"], bag=tmp_path / "link") as new:
        new.part(tmp_path / "link").mkdir()
        new.publish()
    assert not (tmp_path / "link").is_symlink()
    assert sorted(path.name for path in whole.iterdir()) == ["a_0.db3", "a_1.db3", "metadata.yaml"]


def odd_folders(folder: Path) -> dict[str, Path]:
    """Folders that hold something else than one bag, or less."""
    folders = {
        "more": a_bag(folder / "more", "a.db3"),
        "journal": a_bag(folder / "journal", "a.db3"),
        "sub-folder": a_bag(folder / "sub", "a.db3", listed="a.db3, b.db3"),
        "link": a_bag(folder / "linked", "a.db3", listed="a.db3, b.db3"),
        "linked metadata": a_bag(folder / "linked_metadata", "a.db3"),
        "input": a_bag(folder / "input", "a.db3", listed="a.db3, b.db3"),
        "less": a_bag(folder / "less", "a.db3", listed="a.db3, b.db3"),
        "twice": a_bag(folder / "twice", "a.db3", listed="a.db3, a.db3"),
        "elsewhere": a_bag(folder / "elsewhere", "a.db3", listed="../a.db3"),
        "no files": a_bag(folder / "nothing"),
        "no logs": a_bag(folder / "texts", "thesis.tex"),
        "no metadata": a_bag(folder / "lost", "monday.db3", "tuesday.db3"),
    }
    (folders["more"] / "thesis.tex").write_text("years")
    (folders["journal"] / "a.db3-wal").write_text("rows")
    (folders["sub-folder"] / "b.db3").mkdir()
    (folders["link"] / "b.db3").symlink_to(folder / "read.db3")
    (folders["linked metadata"] / "metadata.yaml").rename(folder / "metadata.yaml")
    (folders["linked metadata"] / "metadata.yaml").symlink_to(folder / "metadata.yaml")
    (folder / "read.db3").write_text("read")
    os.link(folder / "read.db3", folders["input"] / "b.db3")
    (folders["no metadata"] / "metadata.yaml").unlink()
    return folders


def test_any_other_folder_is_not_replaced(tmp_path: Path) -> None:
    for path in odd_folders(tmp_path).values():
        before = sorted(path.rglob("*"))
        with pytest.raises(OutputError, match="holds more than a ROS 2 bag and its metadata"):
            refuse([path], overwrite=True, inputs=[tmp_path / "read.db3"], bag=path)
        assert sorted(path.rglob("*")) == before


def test_a_folder_that_has_become_more_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    path = a_bag(tmp_path / "bag", "a.db3")
    with NewFiles([path], bag=path) as new:
        new.part(path).mkdir()
        (path / "thesis.tex").write_text("years")
        with pytest.raises(OutputError, match="it is not replaced"):
            new.publish()
    assert (path / "thesis.tex").read_text() == "years"


@pytest.mark.parametrize("name", ["bag/a.mcap", "bag/a.db3", "bag/sub/a.bag", "link/a.mcap", "bag/../link/a.mcap"])
def test_no_log_becomes_a_part_of_one_that_is_read(tmp_path: Path, name: str) -> None:
    bag = a_bag(tmp_path / "bag", "b.db3")
    (tmp_path / "link").symlink_to(bag)
    with pytest.raises(OutputError) as caught:
        refuse([tmp_path / name], overwrite=True, inputs=[bag, bag / "b.db3"])
    assert str(caught.value) == (f"{tmp_path / name} would be a part of {bag}, which is read; write elsewhere with -o")
    refuse([tmp_path / name], overwrite=True, inputs=[bag / "b.db3"])
    refuse([(tmp_path / name).with_suffix(".parquet")], overwrite=True, inputs=[bag])


@pytest.mark.parametrize("command", ["clean bag", "simulate s.toml", "simulate s.toml --container csv"])
@pytest.mark.parametrize("output", [".", "..", "/", "", "bag/.."])
def test_a_folder_by_any_name_is_no_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str, output: str
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(SCENE, "s.toml")
    shutil.copytree(SAMPLES / "hall", "bag")
    assert run(["-q", *command.split(), "-o", output, "--overwrite"]) == 2
    line = said(capsys)[-1]
    words = " is a folder by any name; give a name of its own to what is to be written"
    assert line.rstrip(".").endswith(words if output else "an empty text names nothing")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "s.toml"]


def test_two_outputs_of_one_name_or_in_each_other(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path)
    for outputs, words in (
        (("a.png", "b.png", "link/a.png"), "{}/link/a.png is to be written twice; give each output a name of its own"),
        (("run", "run/map.yaml"), "{0}/run/map.yaml and {0}/run are in each other's way; give each a place of its own"),
        (("a/b/c", "a"), "{0}/a/b/c and {0}/a are in each other's way; give each a place of its own"),
    ):
        with pytest.raises(OptionError) as caught:
            refuse([tmp_path / name for name in outputs], overwrite=True)
        assert str(caught.value) == words.format(tmp_path)


def test_files_of_several_folders_appear_together_and_name_the_one_without_room(tmp_path: Path) -> None:
    paths = [tmp_path / "a" / "x", tmp_path / "b" / "x"]

    def write_without_room() -> None:
        with NewFiles(paths) as new:
            new.part(paths[1]).write_text("b")
            raise OSError(28, "No space left on device")

    with pytest.raises(OutputError) as caught:
        write_without_room()
    assert str(caught.value) == f"cannot write {paths[0]}: No space left on device"
    assert [*tmp_path.rglob("x")] == []
    with NewFiles(paths) as new:
        for path in paths:
            new.part(path).write_text(path.parent.name)
        new.publish()
    assert [path.read_text() for path in paths] == ["a", "b"]
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "b", "x", "x"]


# Places where nothing can be written, found before the work.


@pytest.mark.slow
@pytest.mark.parametrize("command", ["detect", "background", "plot", "report", "simulate", "file"])
def test_a_folder_that_cannot_be_written(tmp_path: Path, command: str) -> None:
    shut = tmp_path / "shut"
    shut.mkdir()
    room = tmp_path / "room.mcap"
    shutil.copy(ROOM, room)
    run(["-q", "detect", str(room), "-o", str(tmp_path)])
    arguments = {
        "detect": ["detect", room, "-o", shut / "deeper"],
        "file": ["detect", room, "-o", shut / "deeper" / "x.csv"],
        "background": ["background", "build", room, "-o", shut / "deeper" / "x.parquet"],
        "plot": ["plot", room, "-o", shut / "deeper" / "x.png"],
        "report": ["report", tmp_path / "room.objects.parquet", "-o", shut / "deeper" / "x.html"],
        "simulate": ["simulate", SCENE, "-o", shut / "deeper" / "x.mcap"],
    }[command]
    label = f"{room}: " if command == "detect" else ""
    for mode in (0o000, 0o500):
        shut.chmod(mode)
        code, err = lidarcli(*arguments)
        assert (code, err) == (5, f"lidarcli: {label}cannot write {shut / 'deeper'}: Permission denied\n")
    shut.chmod(0o700)
    assert list(shut.iterdir()) == []


def test_an_output_folder_that_is_removed_meanwhile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    publish, out = TableFiles.publish, tmp_path / "out"

    def removed(files: TableFiles, metadata: dict[bytes, bytes]) -> list[str]:
        shutil.rmtree(out)
        return publish(files, metadata)

    monkeypatch.setattr(TableFiles, "publish", removed)
    assert run(["-q", "detect", str(ROOM), "-o", str(out)]) == 5
    (line,) = said(capsys)
    assert line == f"lidarcli: {ROOM}: cannot write {out}/room.objects.parquet: No such file or directory"
    # What becomes of a log that is removed has nothing to do with it.
    refuse_lost(FileNotFoundError(2, "gone", str(ROOM)), out)
    with pytest.raises(OutputError, match="cannot write "):
        refuse_lost(FileNotFoundError(2, "gone", str(out / ".part" / "a")), out)


def test_devices_and_folders_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "folder.html").mkdir()
    os.mkfifo(tmp_path / "pipe.html")
    for name, what in (("folder.html", "a folder"), ("pipe.html", "a device or a pipe")):
        with pytest.raises(OutputError) as caught:
            refuse([tmp_path / name], overwrite=True)
        assert str(caught.value) == f"{tmp_path / name} is {what}; it is not replaced"
    with pytest.raises(OutputError, match=r"^/dev/null is a device or a pipe; it is not replaced$"):
        write_whole(Path("/dev/null"), b"1")


# One file for the objects.


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".ndjson", ".jsonl", ".arrow", ".CSV"])
def test_a_name_with_a_suffix_is_a_file(tmp_path: Path, suffix: str, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    path = tmp_path / f"out{suffix}"
    assert run(["detect", str(ROOM), "-o", str(path)]) == 0
    err = capfdbinary.readouterr().err.decode()
    assert f"  wrote    {path}\n" in err
    kind = {"jsonl": "ndjson"}.get(suffix[1:].lower(), suffix[1:].lower())
    assert run(["-q", "detect", str(ROOM), "-o", "-", "--format", kind]) == 0
    assert path.read_bytes() == capfdbinary.readouterr().out
    assert [item.name for item in tmp_path.iterdir()] == [path.name]
    rows = {
        "parquet": lambda: pq.read_table(path).num_rows,
        "csv": lambda: pyarrow.csv.read_csv(path).num_rows,
        "ndjson": lambda: len(path.read_text().splitlines()),
        "arrow": lambda: pyarrow.ipc.open_stream(path).read_all().num_rows,
    }[kind]()
    assert rows == 499
    # Once more is refused, and a folder of such a name stays a folder.
    assert run(["-q", "detect", str(ROOM), "-o", str(path)]) == 5
    folder = tmp_path / f"folder{suffix}"
    folder.mkdir()
    assert run(["-q", "detect", str(ROOM), "-o", str(folder)]) == 0
    assert sorted(item.name for item in folder.iterdir()) == ["room.objects.parquet", "room.sweeps.parquet"]


@pytest.mark.parametrize("name", ["out.json", "out.csv.gz", "out.TXT"])
def test_a_name_of_another_kind_of_file_is_refused(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["detect", str(ROOM), "-o", str(tmp_path / name)]) == 2
    assert f"{name}: objects are written as .parquet, .csv, .ndjson, .jsonl, .arrow;" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert run(["-q", "detect", str(ROOM), "-o", f"{tmp_path / name}/"]) == 0
    assert (tmp_path / name / "room.objects.parquet").is_file()


def test_nothing_waits_for_a_private_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidarcli.files.newfiles.time.sleep", lambda _: pytest.fail("it waits"))
    with scratch_folder(tmp_path) as outer, scratch_folder(outer) as inner, NewFiles([inner / "x"]) as files:
        files.part(inner / "x").write_bytes(b"x")
        files.publish()
        assert (inner / "x").read_bytes() == b"x"
