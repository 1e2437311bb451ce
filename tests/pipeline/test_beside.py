"""A thread that helps: the same bytes, in the same order, and an end to it whatever happens."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lidarcli.formalism import Parameters
from lidarcli.logs.batches import ReadOptions
from lidarcli.machine import Beside
from lidarcli.pipeline.building import BackgroundBuilder, BuildOptions
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects import making
from lidarcli.pipeline.objects.making import Maker, Part
from lidarcli.pipeline.objects.options import DetectOptions
from lidarcli.pipeline.objects.subtracting import BackgroundOptions
from lidarcli.pipeline.reading import one_log
from tests.places import SAMPLES

DRIVE = Source(str(SAMPLES / "drive.db3"), "drive")
ALONE = DetectOptions(read=ReadOptions(batch_size=8), cores=1)


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What the thread was given, which is called after the first batch; another one reads ahead."""
    monkeypatch.setattr(making, "ALONE", 1)
    monkeypatch.setattr(making, "BLOCK", 1)
    monkeypatch.setattr(one_log, "WORTH_A_THREAD", 0)
    given: list[object] = []

    class Noting(Beside):
        def submit(self, work: Any, /, *arguments: Any, **options: Any) -> Any:
            given.append(arguments)
            return super().submit(work, *arguments, **options)

    monkeypatch.setattr(making, "Beside", Noting)
    return given


def tables(folder: Path, options: DetectOptions) -> tuple[dict[str, bytes], object]:
    summary = detect_to_files(DRIVE, folder, options)
    found = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    return found, replace(summary, seconds=0.0, outputs=[])


def background() -> BackgroundOptions:
    building = BackgroundBuilder(BuildOptions())
    building.add(DRIVE)
    return BackgroundOptions("drive.background.parquet", tuple(building.sensors()))


@pytest.mark.parametrize("kind", ["robust", "paper", "background", "beams"])
def test_the_same_bytes(tmp_path: Path, taken: list[object], kind: str) -> None:
    options = {
        "robust": lambda: ALONE,
        "paper": lambda: replace(ALONE, parameters=Parameters.for_profile("paper")),
        "background": lambda: replace(ALONE, background=background()),
        "beams": lambda: replace(ALONE, beams=True),
    }[kind]()
    expected = tables(tmp_path / "alone", options)
    assert taken == []
    assert tables(tmp_path / "two", replace(options, cores=2)) == expected
    assert len(taken) > 1


def test_an_error_in_the_thread_is_one_of_the_run(
    tmp_path: Path, taken: list[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    make = Maker.make

    def breaks(self: Maker, batches: Any) -> Part:
        if threading.current_thread() is not threading.main_thread():
            raise MemoryError("too much")
        return make(self, batches)

    monkeypatch.setattr(Maker, "make", breaks)
    with pytest.raises(MemoryError, match="too much"):
        tables(tmp_path, replace(ALONE, cores=2))
    assert taken
    assert list(tmp_path.iterdir()) == []
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("detect")] == []


def test_short_logs_need_no_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "Beside", None)
    detect_to_files(DRIVE, tmp_path, replace(ALONE, cores=2))
    assert len(list(tmp_path.iterdir())) == 2
