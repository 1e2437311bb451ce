"""A checkout at work: its package in processes of their own, and the results it has had already."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

from benchmarks.compare import check_out
from benchmarks.same.cases import DONE, OUT, Case
from benchmarks.same.logs import digest_of

WORKER = Path(__file__).with_name("worker.py")
SOURCES = (".py", ".pyx", ".pxd")
BUILT = (".so", ".pyd")
PATIENCE = 300.0
"""Seconds after which a run is taken for one that never ends."""


@dataclass(frozen=True)
class Answer:
    """What became of a case."""

    folder: Path
    codes: list[int]
    said: str

    @property
    def in_short(self) -> str:
        """The exit codes and the last line."""
        last = self.said.strip().splitlines()[-1:]
        return " ".join([*map(str, self.codes), *last])


@dataclass
class Side:
    """A checkout with the package `lidarcli` in it; results go to a folder of the content of the package."""

    tree: Path
    results: Path
    _workers: threading.local = field(default_factory=threading.local)
    _started: list[subprocess.Popen[str]] = field(default_factory=list)

    @cached_property
    def digest(self) -> str:
        """The code with everything compiled, and what it runs on."""
        package = self.tree / "lidarcli"
        files = sorted(path for path in package.rglob("*") if path.suffix in (*SOURCES, *BUILT))
        around = [sys.version, *(version(name) for name in ("numpy", "pyarrow"))]
        around.append(os.environ.get("LIDARCLI_COMPILED", ""))
        return digest_of(
            [("\n".join(around), b""), *((str(path.relative_to(package)), path.read_bytes()) for path in files)]
        )

    def older_than_their_sources(self) -> list[str]:
        """Compiled files that were built before their sources were written."""
        old = []
        for built in sorted(path for path in (self.tree / "lidarcli").rglob("*") if path.suffix in BUILT):
            stem = built.with_name(built.name.split(".")[0])
            sources = [stem.with_suffix(suffix) for suffix in SOURCES]
            if any(path.exists() and path.stat().st_mtime > built.stat().st_mtime for path in sources):
                old.append(str(built.relative_to(self.tree)))
        return old

    def knows(self, case: Case) -> bool:
        """Whether there are results from before."""
        return (self._folder(case) / DONE).exists()

    def answer(self, case: Case) -> Answer:
        """The results of a case, from before where there are some."""
        folder = self._folder(case)
        done = folder / DONE
        if done.exists():
            known = json.loads(done.read_text(encoding="utf-8"))
            return Answer(folder, known["codes"], known["said"])
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        commands = [[word.replace(OUT, str(folder)) for word in command] for command in case.commands]
        line = self._ask(commands)
        if not line:
            return Answer(folder, [self._buried()], "the process died")
        answer = json.loads(line)
        answer["said"] = answer["said"].replace(str(folder), OUT)
        done.write_text(json.dumps(answer), encoding="utf-8")
        return Answer(folder, answer["codes"], answer["said"])

    def close(self) -> None:
        """End the processes."""
        for process in self._started:
            if process.stdin is not None:
                process.stdin.close()
            process.wait()

    def _folder(self, case: Case) -> Path:
        return self.results / self.digest / case.digest

    def _ask(self, commands: list[list[str]]) -> str:
        """The line that this thread's process answers; none where it died, or had to."""
        process = self._process()
        assert process.stdin is not None
        assert process.stdout is not None
        patience = threading.Timer(PATIENCE, process.kill)
        patience.start()
        with suppress(BrokenPipeError):
            process.stdin.write(json.dumps(commands) + "\n")
            process.stdin.flush()
        line = process.stdout.readline()
        patience.cancel()
        return line

    def _buried(self) -> int:
        """The exit code of this thread's process, which is dead; the next case gets another."""
        process: subprocess.Popen[str] = self._workers.process
        del self._workers.process
        return process.wait()

    def _process(self) -> subprocess.Popen[str]:
        """The process of this thread."""
        known: subprocess.Popen[str] | None = getattr(self._workers, "process", None)
        if known is not None:
            return known
        # The folder that this runs in must not come before the checkout: -P.
        process = subprocess.Popen(
            [sys.executable, "-P", "-W", "ignore", str(WORKER)],
            env={**os.environ, "PYTHONPATH": str(self.tree)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._started.append(process)
        assert process.stdout is not None
        hello = process.stdout.readline()
        if not hello:
            raise SystemExit(f"{self.tree}: its lidarcli does not start")
        package = Path(json.loads(hello)["package"])
        if not package.is_relative_to(self.tree):
            raise SystemExit(f"{self.tree}: has no lidarcli of its own, {package} runs in its place")
        self._workers.process = process
        return process


def checkout(base: str, trees: Path) -> Path:
    """The folder of that name, or a checkout of the commit of that name, built once."""
    if (Path(base) / "lidarcli").is_dir():
        return Path(base).resolve()
    named = subprocess.run(
        ["git", "-C", str(Path(__file__).parent), "rev-parse", "--verify", "--quiet", f"{base}^{{commit}}"],
        capture_output=True,
        text=True,
        check=False,
    )
    if named.returncode:
        raise SystemExit(f"{base}: neither a commit nor a checkout of lidarcli")
    tree = trees / named.stdout.strip()
    if not tree.exists():
        print(f"building {base} ...", flush=True)
        part = tree.with_name(f"{tree.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        trees.mkdir(parents=True, exist_ok=True)
        check_out(base, part)
        part.rename(tree)
    return tree
