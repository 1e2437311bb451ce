"""The command line in this process, without its remarks."""

from __future__ import annotations

from collections.abc import Callable

import pytest


@pytest.fixture
def lidarcli(capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Exit code and standard error of a command."""
    from lidarcli.cli import run

    def call(*arguments: object) -> tuple[int, str]:
        code = run(["-q", *map(str, arguments)])
        return code, capfd.readouterr().err

    return call
