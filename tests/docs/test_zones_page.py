"""docs/zones.md tells what happens with a public recording, too."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.places import REAL_LOGS, ROOT, needs_real_logs
from tools import examples


@needs_real_logs
@pytest.mark.slow
def test_the_session_on_a_public_recording(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "zones.md").read_text(encoding="utf-8")
    text = text.replace("```console", "```py").replace("```sh", "```py").replace("```text\n$", "```console\n$")
    (tmp_path / "test-bag").symlink_to(REAL_LOGS / "comprobo24" / "test-bag")
    done = list(examples.run(text, tmp_path))
    assert len(done) == 3
    for one in done:
        assert one.holds, f"$ {one.example.command}\n{one.got}"
