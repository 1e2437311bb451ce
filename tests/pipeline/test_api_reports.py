"""`lidarcli.info` and `lidarcli.report`: what the commands tell, as values."""

from __future__ import annotations

import json
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.pipeline.api.options import several
from tests.places import SAMPLES

ROOM = SAMPLES / "room.mcap"


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    assert run(["-q", "track", str(ROOM), "-o", str(folder)]) == 0
    return folder


def test_info_is_what_the_command_prints(capfd: pytest.CaptureFixture[str]) -> None:
    logs = [ROOM, SAMPLES / "drive.db3"]
    assert run(["-q", "info", *map(str, logs), "--format", "json"]) == 0
    assert lidarcli.info(logs) == json.loads(capfd.readouterr().out)
    (room,) = lidarcli.info(ROOM, range=(0.1, 4.0))
    assert room["scans"][0]["beams_by_status"]["no_return"] > 0
    with pytest.raises(lidarcli.UnreadableError, match=r"^no\.mcap: no such file or folder$"):
        lidarcli.info("no.mcap")


def test_a_report_is_shown_and_written_as_the_command_does(
    tables: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    files = [tmp_path / f"room{suffix}" for suffix in (".md", ".html", ".json", ".xml")]
    report = lidarcli.report(tables, files, log=ROOM)
    for file in files:
        other = tmp_path / f"command{file.suffix}"
        assert run(["-q", "report", str(tables), "--log", str(ROOM), "-o", str(other)]) == 0
        assert file.read_bytes() == other.read_bytes()
    assert run(["-q", "report", str(tables)]) == 0
    assert str(report) == capfd.readouterr().out
    page = report._repr_html_()
    assert page.startswith('<iframe srcdoc="')
    assert unescape(page.partition('srcdoc="')[2].partition('" sandbox')[0]) == files[1].read_text("utf-8")
    # Who has written no page gets one, too.
    assert lidarcli.report(tables, log=ROOM)._repr_html_() == page


def test_what_no_report_can_be_made_of(tables: Path, tmp_path: Path) -> None:
    with pytest.raises(lidarcli.OptionError, match=r"room\.pdf: the suffix names no format \(\.txt \.md "):
        lidarcli.report(tables, tmp_path / "room.pdf")
    with pytest.raises(lidarcli.UnreadableError, match=r"nothing"):
        lidarcli.report(tmp_path / "nothing")
    with pytest.raises(lidarcli.OutputError):
        lidarcli.report(tables, tables / "room.objects.parquet" / "x.md")


def test_paths_may_be_given_by_whatever_holds_several() -> None:
    names = ["a.mcap", "b.mcap"]
    for several_of in (list, set, iter, np.array, pd.Series, lambda each: dict(enumerate(each)).values()):
        assert sorted(several(several_of(names))) == names


def test_tables_in_memory_are_no_paths() -> None:
    with pytest.raises(TypeError, match=r"^logs, files and outputs are named by their paths, not given as Table$"):
        several(pa.table({"log": ["run"]}))
    frame = lidarcli.detect(ROOM, end=0.1).to_pandas()
    with pytest.raises(TypeError, match=r"^logs, files and outputs are .*, not given as DataFrame$"):
        lidarcli.report(frame, frame)
    with pytest.raises(TypeError, match=r"^logs, files and outputs are named by their paths, not given as DataFrame$"):
        lidarcli.report(frame, log=[frame])
    with pytest.raises(TypeError, match=r"^logs, files and outputs are named by their paths, not given as DataFrame$"):
        lidarcli.overlay(ROOM, "x.mcap", objects=frame)
