"""What commands do to the file system, as the system itself sees it: nothing outside of outputs and temporary files."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.logs.hostile_databases import HOSTILE, bag, killed, name_super_journal
from tests.places import SAMPLES
from tests.waiting import HANG

WRITING = re.compile(r"O_WRONLY|O_RDWR|O_CREAT|O_TRUNC|O_APPEND")
OPENING = ("open", "openat", "openat2", "creat")
CHANGING = (
    *("unlink", "unlinkat", "rename", "renameat", "renameat2", "rmdir", "mkdir", "mkdirat", "link", "linkat"),
    *("symlink", "symlinkat", "chmod", "fchmodat", "chown", "lchown", "fchownat", "truncate", "mknod", "mknodat"),
    *("utime", "utimes", "utimensat", "futimesat", "setxattr", "removexattr"),
)

pytestmark = pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")


def changes(folder: Path, *arguments: object) -> tuple[int, set[str]]:
    """Exit code of a command, and what it opened for writing or changed, apart from devices."""
    trace, temporary = folder / "trace", folder / "temporary"
    temporary.mkdir()
    command = ["strace", "-f", "-y", "-qq", "-s", "4096", "-o", str(trace)]
    command += ["-e", f"trace={','.join((*OPENING, *CHANGING))}", sys.executable, "-m", "lidarcli", "-q"]
    environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONDONTWRITEBYTECODE": "1"}
    ran = subprocess.run([*command, *map(str, arguments)], env=environment, capture_output=True, check=False, timeout=HANG)
    assert list(temporary.iterdir()) == []
    touched = set()
    for line in trace.read_text().splitlines():
        call = re.match(r"\d+ +(\w+)\((.*)\) += \S+", line)
        if call is None or (call[1] in OPENING and not WRITING.search(call[2])):
            continue
        for place, name in re.findall(r'(?:<([^>]*)>, )?"((?:[^"\\]|\\.)*)"', call[2]):
            touched.add(str(Path(place or Path.cwd()) / name))
    return ran.returncode, {name for name in touched if not name.startswith(("/dev/", "/proc/", str(temporary)))}


def journal(folder: Path) -> Path:
    """A hot journal that names a victim as its super-journal."""
    path = killed(folder, 30, 120)
    name_super_journal(Path(f"{path}-journal"), str(folder.parent / "victims" / "thesis.tex"))
    return path


def write_ahead_log(folder: Path) -> Path:
    path, work = folder / "run.db3", folder / "work.db3"
    database = bag(work)
    database.execute("PRAGMA journal_mode = wal")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 5, x'00')")
    for suffix in ("", "-wal"):
        shutil.copy(f"{work}{suffix}", f"{path}{suffix}")
    database.close()
    work.unlink()
    return path


def views(folder: Path) -> Path:
    path = folder / "run.db3"
    database = bag(path)
    for statement in HOSTILE["endless messages"][0]:
        database.execute(statement)
    database.close()
    return path


def pipe(folder: Path) -> Path:
    bag(folder / "run_0.db3").close()
    os.mkfifo(folder / "metadata.yaml")
    return folder


def cut(folder: Path) -> Path:
    path = folder / "run.mcap"
    path.write_bytes((SAMPLES / "room.mcap").read_bytes()[:9000])
    return path


@pytest.mark.slow
@pytest.mark.parametrize("make", [journal, write_ahead_log, views, pipe, cut])
def test_reading_changes_nothing(make: Callable[[Path], Path], tmp_path: Path) -> None:
    victims, log = tmp_path / "victims", tmp_path / "log"
    for folder in (victims, log):
        folder.mkdir()
    victim = victims / "thesis.tex"
    victim.write_text("years of work")
    path = make(log)
    code, touched = changes(tmp_path, "info", path)
    assert code in (0, 3)
    assert touched == set()
    assert victim.read_text() == "years of work"


def test_writing_changes_the_outputs_alone(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, touched = changes(tmp_path, "detect", SAMPLES / "room.mcap", "-o", out)
    assert code == 0
    assert {name for name in touched if not name.startswith(str(out))} == set()
    names = {re.sub(r"\.lidarcli-[0-9a-f]{8}-[0-9a-f]{16}\.part", "PART", name).removeprefix(str(out)) for name in touched}
    tables = {"room.objects.parquet", "room.sweeps.parquet"}
    assert names == {"", "/PART", *(f"/PART/{name}" for name in tables), *(f"/{name}" for name in tables)}
