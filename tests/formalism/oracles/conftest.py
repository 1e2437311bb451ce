"""Skip this folder while the core is compiled: compiled modules do not show their steps."""

from __future__ import annotations

from pathlib import Path

import pytest

from lidarcli import compiled

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if compiled.is_there() and compiled.is_wanted():
        for item in items:
            if HERE in item.path.parents:
                item.add_marker(pytest.mark.skip(reason="runs on the core's source: LIDARCLI_COMPILED=no"))
