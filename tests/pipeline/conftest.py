"""Opening a log gives one in memory."""

from __future__ import annotations

import pytest

from lidarcli.logs.base import Topic
from lidarcli.pipeline import detecting, inspecting
from lidarcli.pipeline.reading import one_log
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
