"""What a shell completes, asked as a shell asks."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest

Run = Callable[..., Any]
HEAVY = ("numpy", "pandas", "pyarrow", "mcap", "rich", "matplotlib")


def completed(*words: str) -> list[str]:
    """The completions of the last of the words, as bash gets them."""
    code = (
        "import sys; from lidarcli.cli import run\n"
        "try: run([])\nexcept SystemExit: pass\n"
        f"print(*[name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code],
        env={
            "_LIDARCLI_COMPLETE": "bash_complete",
            "COMP_WORDS": " ".join(["lidarcli", *words]),
            "COMP_CWORD": str(len(words)),
            "PYTHONPATH": ":".join(sys.path),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stderr.strip() == "", "something heavy was imported"
    return [line.split(",")[1] for line in ran.stdout.splitlines()]


def test_commands_options_and_values_are_completed() -> None:
    assert completed("de") == ["detect"]
    assert completed("background", "") == ["build", "subtract"]
    assert completed("background", "subtract", "--any") == ["--any-frame"]
    assert completed("background", "build", "--station-") == ["--station-distance", "--station-angle"]
    assert completed("detect", "--min-") == ["--min-beams", "--min-thing"]
    assert completed("detect", "--profile", "") == ["robust", "paper"]
    assert completed("completion", "") == ["bash", "zsh", "fish"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_one_that_the_shell_takes(lidarcli: Run, shell: str) -> None:
    ran = lidarcli("completion", shell)
    assert (ran.code, ran.err) == (0, "")
    assert f"_LIDARCLI_COMPLETE={shell}_complete" in ran.out
    if (program := shutil.which(shell)) is not None:
        subprocess.run([program, "-n"], input=ran.out, text=True, check=True)
