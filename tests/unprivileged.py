"""Commands run as somebody to whom permissions apply, even where the tests are run by root."""

from __future__ import annotations

import subprocess
import sys

from tests.waiting import HANG

_DROP = """
import ctypes, os, sys
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 24, 1, 2
if os.geteuid() == 0:
    for capability in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
        ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


def lidarcli(*arguments: object) -> tuple[int, str]:
    """Exit code and standard error of `lidarcli ARGUMENTS`."""
    command = [sys.executable, "-c", _DROP, "-m", "lidarcli", *map(str, arguments)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG)
    return ran.returncode, ran.stderr
