"""Logs in memory, and counts of the passes that check paths."""

from __future__ import annotations

from typing import Any

import pytest

from lidarcli.logs.base import Log, Topic
from lidarcli.pipeline import detecting, inspecting
from lidarcli.pipeline.reading import one_log, path_check
from lidarcli.sweeps.types import RawSweeps
from tests.fake_log import FakeLog
from tests.pipeline.in_memory import Opens


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Opens:
    """Make opening return a fake log."""

    def opens(*blocks: RawSweeps, topics: list[Topic] | None = None, damage: str | None = None) -> FakeLog:
        log = FakeLog(blocks, topics, damage=damage)
        for module in (one_log, detecting, inspecting):
            monkeypatch.setattr(module, "open_source", lambda source, csv: log)
        return log

    return opens


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Logs whose paths were looked at."""
    found: list[object] = []
    check = path_check.check_paths

    def counted(log: Log, *args: Any, **options: Any) -> object:
        found.append(log)
        return check(log, *args, **options)

    monkeypatch.setattr(path_check, "check_paths", counted)
    return found
