"""Bad input of every kind: one exact line on stderr, the documented exit code, and no file."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lidarcli.cli.commands import version_text
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.pipeline import detecting
from lidarcli.simulation.writers import write_log
from lidarcli.system import machine
from tests.places import SAMPLES
from tests.waiting import HANG, endless, wait_until

Run = Callable[..., Any]

SUFFIXES = "*.mcap *.bag *.active *.db3 *.zstd *.clf *.gfs *.clf.gz *.gfs.gz *.csv *.csv.gz"


@pytest.fixture(params=["info", "detect"])
def command(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A command that reads logs, in an empty current directory."""
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    return str(request.param)


def check(ran: Any, code: int, line: str) -> None:
    assert (ran.code, ran.err) == (code, f"lidarcli: {line}\n")
    assert list(Path.cwd().iterdir()) == []


def test_no_such_file(command: str, lidarcli: Run) -> None:
    check(lidarcli(command, "absent.mcap"), 3, "absent.mcap: no such file or folder")


@pytest.mark.parametrize("data", [bytes(range(256)) * 40, b""])
def test_a_file_that_is_no_log(command: str, data: bytes, tmp_path: Path, lidarcli: Run) -> None:
    path = tmp_path / "noise.mcap"
    path.write_bytes(data)
    ran = lidarcli(command, path)
    assert (ran.code, ran.err.count("\n")) == (3, 1)
    assert ran.err.startswith(f"lidarcli: {path}: ")
    assert list(Path.cwd().iterdir()) == []


def test_folder_without_logs(command: str, tmp_path: Path, lidarcli: Run) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "notes.md").touch()
    check(lidarcli(command, folder), 3, f"{folder}: no log in this folder (searched for {SUFFIXES})")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_no_permission(command: str, tmp_path: Path, lidarcli: Run) -> None:
    path = tmp_path / "secret.mcap"
    path.touch(mode=0o000)
    check(lidarcli(command, path), 3, f"{path}: cannot be opened: Permission denied")


def test_wrong_topic(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("detect", logs / "two.mcap", "--topic", "/left", "-o", tmp_path / "out")
    line = f"{logs / 'two.mcap'}: no LaserScan topic /left in this log (its LaserScan topics: /front, /rear)"
    assert (ran.code, ran.err) == (4, f"lidarcli: {line}\n")
    assert not (tmp_path / "out").exists()


def test_wrong_topic_beside_a_right_one(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    assert lidarcli("-q", "detect", logs / "two.mcap", "--topic", "/left", "--topic", "front", "-o", tmp_path).code == 4
    assert (tmp_path / "two.objects.parquet").exists()


def test_existing_output(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    taken = tmp_path / "run.sweeps.parquet"
    taken.write_text("mine")
    ran = lidarcli("detect", logs / "run.mcap", "-o", tmp_path)
    line = f"{taken} exists; use --overwrite to replace it, or -o to write elsewhere"
    assert (ran.code, ran.err) == (5, f"lidarcli: {logs / 'run.mcap'}: {line}\n")
    assert taken.read_text() == "mine"
    assert lidarcli("detect", logs / "run.mcap", "-o", tmp_path, "--overwrite").code == 0
    assert taken.read_bytes()[:4] == b"PAR1"


def test_two_inputs_one_output(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    (tmp_path / "run.bag").touch()
    ran = lidarcli("detect", logs / "run.mcap", tmp_path / "run.bag", "-o", tmp_path / "out")
    both = f"{logs / 'run.mcap'} and {tmp_path / 'run.bag'}"
    assert (ran.code, ran.err) == (2, f"lidarcli: {both} would both write run.*; run them apart with -o\n")
    assert not (tmp_path / "out").exists()


def test_damaged_log_gives_what_is_left(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("-q", "detect", logs / "cut.mcap", "-o", tmp_path, code=3)
    assert ran.err.startswith(f"lidarcli: {logs / 'cut.mcap'}: byte ")
    import pyarrow.parquet as pq

    table = pq.read_table(tmp_path / "cut.sweeps.parquet")
    assert 50 < table.num_rows < 400
    assert table["sweep"].to_pylist() == list(range(table.num_rows))
    assert b"lidarcli.damage" in table.schema.metadata


def test_cut_before_the_first_sweep(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    """A listing without topics is no proof that the log had no LaserScan."""
    log = tmp_path / "cut.mcap"
    log.write_bytes((logs / "run.mcap").read_bytes()[:300])
    for words in (("info", log), ("detect", log, "-o", tmp_path)):
        ran = lidarcli("-q", *words, code=3)
        assert "byte 300: " in ran.err
    assert list(tmp_path.iterdir()) == [log]


def test_first_code_that_is_not_zero_and_all_logs_done(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    out = tmp_path / "out"
    (tmp_path / "empty.bag").touch()
    inputs = [logs / "two.mcap", tmp_path / "empty.bag", logs / "run.mcap", tmp_path / "absent"]
    ran = lidarcli("detect", *inputs, "--topic", "/scan", "-o", out, code=4)
    assert sorted(path.name for path in out.iterdir()) == ["run.objects.parquet", "run.sweeps.parquet"]
    assert ran.err.splitlines()[0].startswith(f"lidarcli: {logs / 'two.mcap'}: no LaserScan topic /scan")
    assert ran.err.splitlines()[-1] == "4 logs, 3 with errors: 20 sweeps, 30 objects"


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--threshold", "big", "'big' is neither adaptive nor mean nor a number of metres."),
        ("--every", "99999999999999999999", "99999999999999999999 is above 1000000."),
        ("--no-return", "zero,1e308", "1e+308 is no range."),
        ("--angle-increment", "0", "0 is no step from beam to beam."),
        ("--format", "xml", "'xml' is not one of 'ndjson', 'csv', 'arrow', 'parquet', 'json'."),
    ],
)
def test_unknown_option_value(lidarcli: Run, option: str, value: str, message: str) -> None:
    ran = lidarcli("detect", "run.mcap", option, value)
    assert (ran.code, ran.err.splitlines()[-1]) == (2, f"Error: Invalid value for '{option}': {message}")


@pytest.mark.parametrize(
    ("words", "refused"),
    [
        ("detect --range 5 1", "--range"),
        ("detect -o - --beams", "--beams"),
        ("detect --format csv", "--format"),
        ("detect --start 5 --end 5", "--start"),
        ("detect --cluster local:2 --jobs 2", "--jobs"),
        ("background build --dry-run --format json -o b.parquet", "--dry-run"),
        ("info --brief --format json", "--brief"),
        ("info -o robot.toml", "--output"),
        ("map -o m.yaml --voxel 0.1", "--voxel"),
        ("plot --sweep 1 --sweeps 2", "--sweep"),
        ("plot --at 3 --animate", "--at"),
        ("plot --start 1", "--start"),
        ("plot --view map --animate", "--animate"),
        ("plot --fps 3", "--fps"),
        ("plot --follow 3", "--follow"),
        ("plot --follow 3 --tracks a --view map", "--follow"),
        ("plot --dpi 99 -o a.svg", "--dpi"),
    ],
)
def test_options_that_do_not_fit(words: str, refused: str, logs: Path, lidarcli: Run) -> None:
    ran = lidarcli(*words.split(), logs / "run.mcap")
    usage, *_, error = ran.err.splitlines()
    assert ran.code == 2
    assert usage.startswith("Usage: lidarcli ")
    assert error.startswith("Error: ")
    assert refused in error


def test_no_input_and_no_command(lidarcli: Run) -> None:
    assert lidarcli("detect").err.splitlines()[-1] == "Error: Missing argument 'LOG...'."
    assert lidarcli("detect").code == 2
    assert lidarcli("explode").err.splitlines()[-1] == "Error: No such command 'explode'. Did you mean 'export'?"


@pytest.mark.parametrize(
    "log", [str(SAMPLES / "room.mcap"), str(SAMPLES / "hall"), "gone.bag", "s3://logs/*.mcap", "-", "a b"]
)
def test_a_log_without_a_command_is_told_what_to_do_next(lidarcli: Run, log: str) -> None:
    ran = lidarcli(log, "--more")
    assert (ran.code, ran.out) == (2, "")
    first, second = ran.err.splitlines()[-2:]
    assert first.endswith(f" lidarcli info {shlex.quote(log)}")
    assert "lidarcli track LOG" in second
    assert "lidarcli zones LOG" in second


def test_a_folder_of_a_plain_name_is_a_log(lidarcli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("explode").mkdir()
    assert "lidarcli info explode" in lidarcli("explode").err
    assert lidarcli("-v", "-q", "info", "x").err.splitlines()[-1] == ("Error: --verbose and --quiet exclude each other")


def test_bug_in_one_log_is_reported_and_the_rest_done(
    logs: Path, tmp_path: Path, lidarcli: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = detecting.open_source

    def buggy(source: Any, csv: Any) -> Any:
        if source.name == "two":
            raise ZeroDivisionError("oops")
        return real(source, csv)

    monkeypatch.setattr(detecting, "open_source", buggy)
    ran = lidarcli("-q", "detect", logs / "two.mcap", logs / "run.mcap", "-o", tmp_path, code=70)
    assert ran.err.startswith("Traceback (most recent call last):\n")
    assert ran.err.splitlines()[-3:] == [
        "ZeroDivisionError: oops",
        "lidarcli: this is a bug in lidarcli; please report it with the lines above",
        f"lidarcli: {logs / 'two.mcap'}: internal error: ZeroDivisionError: oops",
    ]
    assert (tmp_path / "run.objects.parquet").exists()


def test_bug_outside_of_any_log(lidarcli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidarcli.pipeline.inputs.search.find_logs", lambda names: 1 / 0)
    ran = lidarcli("info", "x", code=70)
    assert ran.err.splitlines()[-1] == "lidarcli: this is a bug in lidarcli; please report it with the lines above"


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_interrupt_in_the_middle_leaves_no_file(large: bytes, tmp_path: Path, jobs: int) -> None:
    """Logs that come through pipes and do not end are interrupted while their tables are being written."""
    (tmp_path / "large.mcap").write_bytes(large)
    pipes = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    out = tmp_path / "out"
    command = [sys.executable, "-m", "lidarcli", "detect", *map(str, pipes), "-o", str(out), "--jobs", str(jobs)]
    with endless(tmp_path / "large.mcap", *pipes):
        running = subprocess.Popen(command, stderr=subprocess.PIPE)
        wait_until(lambda: len(list(out.glob(".*.part/*"))) == 2 * jobs, running)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=HANG)
    assert (running.returncode, err.decode()) == (130, "lidarcli: interrupted\n")
    assert list(out.iterdir()) == []


def test_full_disk_is_one_line_and_leaves_no_file(logs: Path, tmp_path: Path) -> None:
    """A limit on the size of files stands in for a full disk."""
    command = [sys.executable, "-m", "lidarcli", "detect", str(logs / "run.mcap"), "--beams", "-o", str(tmp_path / "out")]
    ran = subprocess.run(["sh", "-c", 'ulimit -f 8; exec "$@"', "sh", *command], capture_output=True, check=False)
    path = tmp_path / "out" / "run.objects.parquet"
    line = f"lidarcli: {logs / 'run.mcap'}: cannot write {path}: File too large\n"
    assert (ran.returncode, ran.stderr.decode()) == (5, line)
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "code", "out", "err"),
    [
        (["--version"], 0, f"{version_text()}\n", ""),
        (["info", "nothing.mcap"], 3, "", "lidarcli: nothing.mcap: no such file or folder\n"),
        (["--nothing"], 2, "", None),
    ],
)
def test_the_process_says_all_and_exits_with_the_code(arguments: list[str], code: int, out: str, err: str | None) -> None:
    ran = subprocess.run([sys.executable, "-m", "lidarcli", *arguments], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (code, out)
    assert err is None or ran.stderr == err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "out", "err"),
    [
        ("--help >&-", 0, "", ""),
        ("--version >/dev/full", 5, "", "lidarcli: cannot write standard output: No space left on device\n"),
        ("info run.mcap >&-", 0, "", ""),
        ("info run.mcap >/dev/full", 5, "", "lidarcli: cannot write standard output: No space left on device\n"),
        ("-q detect run.mcap -o DIR --overwrite >&- 2>&-", 0, "", ""),
        ("detect run.mcap -o - >/dev/full", 5, "", None),
        ("detect run.mcap -o - >&-", 5, "", "lidarcli: cannot write standard output: it is closed\n"),
        ("plot run.mcap --sweep 1 -o - >&-", 5, "", "lidarcli: cannot write standard output: it is closed\n"),
        ("detect nothing.mcap -o DIR 2>&-", 3, "", ""),
    ],
)
def test_standard_streams_that_are_closed_or_full(
    logs: Path, tmp_path: Path, words: str, code: int, out: str, err: str | None
) -> None:
    line = f'"{sys.executable}" -m lidarcli {words.replace("DIR", str(tmp_path / "out"))}'
    ran = subprocess.run(["sh", "-c", line], cwd=logs, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (code, out)
    assert ran.stderr == err if err is not None else ran.stderr.endswith(": No space left on device\n")


def test_odd_names_of_files_neither_break_lines_nor_the_run(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    folder = tmp_path / "odd"
    folder.mkdir()
    names = [b"a\nb\x1b[2J.mcap", b"latin-\xff.mcap"]
    for name in names:
        Path(os.fsdecode(bytes(folder) + b"/" + name)).write_bytes((logs / "run.mcap").read_bytes())
    assert lidarcli("detect", folder, "-o", tmp_path / "out").code == 0
    written = sorted(os.listdir(os.fsencode(tmp_path / "out")))  # noqa: PTH208 (names as bytes)
    assert written == [
        name.removesuffix(b".mcap") + ending for name in names for ending in (b".objects.parquet", b".sweeps.parquet")
    ]
    assert lidarcli("-q", "detect", folder, "-o", "-").code == 0
    ran = lidarcli("info", folder)
    heads = [line for line in ran.out.splitlines() if line and not line.startswith(" ")]
    assert heads == [f"{folder}/a\\nb\\x1b[2J.mcap", f"{folder}/latin-\\udcff.mcap"]
    infos = json.loads(lidarcli("info", folder, "--format", "json").out)
    assert [os.fsencode(info["path"]) for info in infos] == [bytes(folder) + b"/" + name for name in names]


def test_names_in_a_log_do_not_steer_the_terminal(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    path = tmp_path / "run.mcap"
    with open_log(logs / "run.mcap") as log:
        write_log(path, [replace(block, topic="/scan\n\x1b[31m") for block in log.scans(None, ReadReport())])
    for ran in (lidarcli("info", path), lidarcli("detect", path, "--topic", "/x", "-o", tmp_path)):
        assert "/scan\\n\\x1b[31m" in ran.out + ran.err
        assert "\x1b" not in ran.out + ran.err


@pytest.mark.parametrize("error", [MemoryError(), ImportError("libarrow.so: failed to map segment from shared object")])
@pytest.mark.parametrize("place", ["open_source", "keep_freed_memory"])
def test_too_little_memory_is_no_bug(
    error: Exception, place: str, lidarcli: Run, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: object, **named: object) -> None:
        raise error

    inside = place == "open_source"
    monkeypatch.setattr(detecting if inside else machine, place, fail)
    ran = lidarcli("-q", "detect", logs / "run.mcap", "-o", tmp_path, code=3)
    log = f"{logs / 'run.mcap'}: " if inside else ""
    advice = "allow more, take --jobs 1, or read a part of the log with --start and --end or --every"
    assert ran.err == f"lidarcli: {log}not enough memory; {advice}\n"
    assert lidarcli("info", "x?aws_secret_access_key=K").err.startswith("lidarcli: x?aws_secret_access_key=...: no")
    assert "pass" not in lidarcli("detect", "x", "-o", "https://me:pass@host/x.txt").err


@pytest.mark.parametrize(
    "words",
    [
        *(("diff", "a.mcap", ""), ("zones", "", "--zones", "z.toml")),
        *(("report", "t", "--baseline", ""), ("report", "t", "--log", "")),
        *(("track", "a.mcap", "-o", ""), ("track", "a.mcap", "--columns", ""), ("track", "a.mcap", "--base", "")),
        *(("export", "a.parquet", "-o", "x.csv", "--only", ""), ("plot", "a.mcap", "--tracks", "")),
    ],
)
def test_an_empty_text_is_no_folder(words: tuple[str, ...], lidarcli: Run) -> None:
    """A variable of a shell that is not set would read, or write, whatever lies in the current folder."""
    ran = lidarcli(*words, code=2)
    assert "an empty text names nothing." in ran.err
