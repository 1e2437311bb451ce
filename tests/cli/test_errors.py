"""Bad input of every kind: one exact line on stderr, the documented exit code, and no file."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lidarcli import machine
from lidarcli.cli.settings import version_text
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.pipeline import detecting
from lidarcli.screen import one_line
from lidarcli.simulation.writers import write_log
from tests.waiting import HANG, endless, wait_until

Run = Callable[..., Any]

NOT_A_LOG = "not a log lidarcli knows; it reads "
SUFFIXES = "*.mcap *.bag *.active *.db3 *.csv *.csv.gz *.zstd *.clf *.gfs *.clf.gz *.gfs.gz"


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


def test_not_a_log(command: str, tmp_path: Path, lidarcli: Run) -> None:
    path = tmp_path / "noise.mcap"
    path.write_bytes(bytes(range(256)) * 40)
    ran = lidarcli(command, path)
    assert ran.code == 3
    assert ran.err.startswith(f"lidarcli: {path}: {NOT_A_LOG}")
    assert ran.err.count("\n") == 1
    assert list(Path.cwd().iterdir()) == []


def test_empty_file(command: str, tmp_path: Path, lidarcli: Run) -> None:
    path = tmp_path / "empty.mcap"
    path.touch()
    check(lidarcli(command, path), 3, f"{path}: is empty")


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
    ran = lidarcli("-q", "detect", logs / "two.mcap", "--topic", "/left", "--topic", "front", "-o", tmp_path)
    line = f"{logs / 'two.mcap'}: no LaserScan topic /left in this log"
    assert (ran.code, ran.err) == (4, f"lidarcli: {line}\n")
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


def test_output_folder_is_a_file(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    (tmp_path / "out").touch()
    ran = lidarcli("detect", logs / "run.mcap", "-o", tmp_path / "out")
    line = f"{logs / 'run.mcap'}: cannot write below {tmp_path / 'out'}: it is not a folder"
    assert (ran.code, ran.err) == (5, f"lidarcli: {line}\n")


def test_two_inputs_one_output(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    (tmp_path / "run.bag").touch()
    ran = lidarcli("detect", logs / "run.mcap", tmp_path / "run.bag", "-o", tmp_path / "out")
    both = f"{logs / 'run.mcap'} and {tmp_path / 'run.bag'}"
    assert (ran.code, ran.err) == (2, f"lidarcli: {both} would both write run.*; run them apart with -o\n")
    assert not (tmp_path / "out").exists()


def test_damaged_log_gives_what_is_left(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("-q", "detect", logs / "cut.mcap", "-o", tmp_path)
    assert ran.code == 3
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
    for command in (("info", log), ("detect", log, "-o", tmp_path)):
        ran = lidarcli("-q", *command)
        assert ran.code == 3
        assert "byte 300: the log is cut off here" in ran.err
    assert list(tmp_path.iterdir()) == [log]


def test_first_code_that_is_not_zero_and_all_logs_done(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    out = tmp_path / "out"
    (tmp_path / "empty.bag").touch()
    inputs = [logs / "two.mcap", tmp_path / "empty.bag", logs / "run.mcap", tmp_path / "absent"]
    ran = lidarcli("detect", *inputs, "--topic", "/scan", "-o", out)
    assert ran.code == 4
    assert sorted(path.name for path in out.iterdir()) == ["run.objects.parquet", "run.sweeps.parquet"]
    assert ran.err.splitlines()[0].startswith(f"lidarcli: {logs / 'two.mcap'}: no LaserScan topic /scan")
    assert ran.err.splitlines()[-1] == "4 logs, 3 with errors: 20 sweeps, 30 objects"


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--threshold", "big", "'big' is neither adaptive nor mean nor a number of metres."),
        ("--threshold", "-1", "-1 is not above 0."),
        ("--threshold", "nan", "'nan' is not a finite number."),
        ("--profile", "fast", "'fast' is not one of 'robust', 'paper'."),
        ("--min-beams", "0", "0 is below 1."),
        ("--max-width", "0", "0 is not above 0."),
        ("--max-gap", "-1", "-1 is below 0."),
        ("--group-gap", "-0.1", "-0.1 is below 0."),
        ("--every", "0", "0 is below 1."),
        ("--jobs", "0", "0 is below 1."),
        ("--start", "-1", "-1 is below 0."),
        *(
            (option, value, f"{value} is above 1000000.")
            for option in ("--min-beams", "--max-gap", "--every")
            for value in ("1000001", "1099511627776", "99999999999999999999")
        ),
        ("--threshold", "1e300", "1e300 is above 1e+06."),
        ("--max-width", "1e308", "1e308 is above 1e+06."),
        ("--group-gap", "1e7", "1e7 is above 1e+06."),
        ("--station-distance", "1e308", "1e308 is above 1e+06."),
        ("--range-max", "1e308", "1e308 is above 1e+06."),
        ("--start", "1e300", "'1e300' is more than 1e+09 seconds."),
        (
            "--end",
            "soon",
            "'soon' is no time: give seconds after the first sweep (12.5, 500ms, 2min) or date and time "
            "(2026-11-22T10:00:00Z).",
        ),
        ("--no-return", "zero,1e308", "1e+308 is no range."),
        ("--no-return", "nan,1e999", "inf is no range."),
        ("--fov", "1e9", "1e9 is above 1e+06."),
        ("--fov", "12.6", "12.6 radians are more than two turns; --degrees says that angles are degrees."),
        ("--angle-increment", "1e300", "1e300 is above 1e+06."),
        ("--angle-min", "-13", "-13 radians are more than two turns; --degrees says that angles are degrees."),
        ("--angle-min", "-1e300", "-1e300 is below -1e+06."),
        (
            "--no-return",
            "zero,naught",
            "'naught' is neither a number nor one of inf, zero, max, above, pile, nan, negative, below.",
        ),
        ("--format", "xml", "'xml' is not one of 'ndjson', 'csv', 'arrow', 'parquet', 'json'."),
        ("--range-max", "0", "0 is not above 0."),
        ("--angle-increment", "0", "0 is no step from beam to beam."),
        ("--range-unit", "ft", "'ft' is not one of 'm', 'cm', 'mm'."),
    ],
)
def test_unknown_option_value(lidarcli: Run, option: str, value: str, message: str) -> None:
    ran = lidarcli("detect", "run.mcap", option, value)
    assert ran.code == 2
    last = ran.err.splitlines()[-1]
    assert last.startswith("Error: Invalid value for ")
    assert f"'{option}'" in last
    assert last.endswith(f": {message}")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--range", "5", "1"), "Invalid value for '--range': 5 to 1 m is no range; give the least and the greatest."),
        (("--range", "0", "1e308"), "Invalid value for '--range': 1e308 is above 1e+06."),
        (("--fov", "721", "--degrees"), "Invalid value for '--fov': 721 degrees are more than two turns."),
        (("-o", "-", "--beams"), "--beams writes a file: give -o DIR"),
        (("--format", "csv"), "--format is for the stream of -o -, or json for the summary; tables are Parquet"),
        (("--start", "5", "--end", "5"), "--start 5 is not before --end 5"),
        (("--fov", "3", "--angle-increment", "1"), "--angle-increment and --fov exclude each other"),
    ],
)
def test_options_that_do_not_fit(lidarcli: Run, arguments: tuple[str, ...], message: str) -> None:
    ran = lidarcli("detect", "run.mcap", *arguments)
    assert (ran.code, ran.err.splitlines()[-1]) == (2, f"Error: {message}")


def test_no_input_and_no_command(lidarcli: Run) -> None:
    assert lidarcli("detect").err.splitlines()[-1] == "Error: Missing argument 'LOG...'."
    assert lidarcli("detect").code == 2
    assert lidarcli("explode").err.splitlines()[-1] == "Error: No such command 'explode'. Did you mean 'export'?"
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
    ran = lidarcli("-q", "detect", logs / "two.mcap", logs / "run.mcap", "-o", tmp_path)
    assert ran.code == 70
    assert ran.err.startswith("Traceback (most recent call last):\n")
    assert ran.err.splitlines()[-3:] == [
        "ZeroDivisionError: oops",
        "lidarcli: this is a bug in lidarcli; please report it with the lines above",
        f"lidarcli: {logs / 'two.mcap'}: internal error: ZeroDivisionError: oops",
    ]
    assert (tmp_path / "run.objects.parquet").exists()


def test_bug_outside_of_any_log(lidarcli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidarcli.pipeline.inputs.search.find_logs", lambda names: 1 / 0)
    ran = lidarcli("info", "x")
    assert ran.code == 70
    assert ran.err.splitlines()[-1] == "lidarcli: this is a bug in lidarcli; please report it with the lines above"


def test_interrupt(lidarcli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*names: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("lidarcli.pipeline.inputs.search.find_logs", interrupted)
    ran = lidarcli("detect", "x")
    assert (ran.code, ran.err) == (130, "lidarcli: interrupted\n")


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
        ("detect run.mcap -o - >&-", 5, "", "lidarcli: cannot write standard output: it is closed\n"),
        ("plot run.mcap --sweep 1 -o - >&-", 5, "", "lidarcli: cannot write standard output: it is closed\n"),
        ("detect nothing.mcap -o DIR 2>&-", 3, "", ""),
    ],
)
def test_standard_streams_that_are_closed_or_full(
    logs: Path, tmp_path: Path, words: str, code: int, out: str, err: str
) -> None:
    line = f'"{sys.executable}" -m lidarcli {words.replace("DIR", str(tmp_path / "out"))}'
    ran = subprocess.run(["sh", "-c", line], cwd=logs, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (code, out, err)


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


def test_a_line_is_of_bounded_length() -> None:
    assert one_line("a" * 1000) == "a" * 1000
    assert one_line("a" * 5000 + "end") == "a" * 500 + " ... " + "a" * 247 + "end"
    assert len(one_line("\0" * 5000)) == 755


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
    ran = lidarcli("-q", "detect", logs / "run.mcap", "-o", tmp_path)
    assert ran.code == 3
    log = f"{logs / 'run.mcap'}: " if inside else ""
    advice = "allow more, take --jobs 1, or read a part of the log with --start and --end or --every"
    assert ran.err == f"lidarcli: {log}not enough memory; {advice}\n"
    assert lidarcli("info", "x?aws_secret_access_key=K").err.startswith("lidarcli: x?aws_secret_access_key=...: no")
    assert "pass" not in lidarcli("detect", "x", "-o", "https://me:pass@host/x.txt").err
