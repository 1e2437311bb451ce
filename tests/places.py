"""Where the tests find logs: the samples of the project, and public recordings where somebody has them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "samples"
REAL_LOGS = Path(os.environ.get("LIDARCLI_REAL_LOGS", ""))
"""Folder of public recordings, which are no part of the project (test_real_logs.py lists them)."""

needs_real_logs = pytest.mark.skipif(
    not os.environ.get("LIDARCLI_REAL_LOGS"), reason="LIDARCLI_REAL_LOGS names no folder of real logs"
)
