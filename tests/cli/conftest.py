"""What tests of several commands share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.maps import WALK


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`walk.mcap` in a room with a thing that comes and stops, and `truth.yaml`, its true map."""
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("walk")
    (folder / "walk.toml").write_text(WALK)
    words = ("-q", "simulate", folder / "walk.toml", "-o", folder / "walk.mcap", "--map", folder / "truth.yaml")
    assert run([str(word) for word in words]) == 0
    return folder
