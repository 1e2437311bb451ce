"""Commands that read a log twice decide once on its paths, and a brief `info` on none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import Ran
from tests.places import SAMPLES

DRIVE = SAMPLES / "drive.db3"


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (("zones", DRIVE, "--zones", "zones.toml"), 1),
        (("diff", DRIVE, DRIVE), 2),
        (("clean", DRIVE, "-o", "clean.db3"), 1),
        (("info", DRIVE), 1),
        (("info", DRIVE, "--brief"), 0),
        (("info", DRIVE, "--brief", "--check", "findings.delay == 0"), 1),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_log_is_looked_at_once(
    looks: list[object],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    lidarcli: Callable[..., Ran],
    command: tuple[object, ...],
    expected: int,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "zones.toml").write_text('[[zone]]\nname = "a"\npolygon = [[-2, -2], [2, -2], [2, 2]]\n')
    assert lidarcli(*command).code == 0
    assert len(looks) == expected
