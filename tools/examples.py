"""The examples in the Markdown pages: run them, compare what they print, write it anew.

A fenced block whose info string names a file (` ```toml room.toml `) is that file. A `console` block holds
commands after `$ ` (and `> `) and what they print, where `...` stands for any text. A `sh` block holds commands to
run, output aside, and so does the row of a table that begins with a question in bold. The commands of README.md run where
`make demo` has been.

Lines that only call `lidarcli` or `python` run in this process, which has imported what they need; all others run in a
shell.
"""

from __future__ import annotations

import contextlib
import doctest
import os
import re
import runpy
import shlex
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

ROOT = Path(__file__).parent.parent
PART = re.compile(
    r"^```(?P<language>[a-z]+)(?: (?P<file>\S+))?\n(?P<body>.*?)^```$|^\| \*\*[^\n|]*\?\*\*(?P<row>[^\n]*)",
    re.MULTILINE | re.DOTALL,
)
IN_ROW = re.compile(r"`(lidarcli [^`]+)`")
COMMAND = re.compile(r"^\$ (?P<command>[^\n]*(?:\n> [^\n]*)*)\n(?P<output>(?:(?!\$ )[^\n]*\n)*)", re.MULTILINE)
ENVIRONMENT = {"COLUMNS": "80", "LC_ALL": "C.UTF-8", "TZ": "UTC"}
FIRST = re.compile(r"(?P<call>lidarcli .*?)(?P<joint> 2>&1 \| | \| |; )(?P<rest>.*)", re.DOTALL)
"""A call of lidarcli before something that needs a shell: what it prints, or its exit code, goes on there."""
STOPPING = "set -e\n"
"""Lets a shell stop at the first command that fails."""
HANG = 600
"""[s] after which a command counts as one that hangs, however busy the machine is."""
VOLATILE = re.compile(r"(?<=, )[\d,]+(?= sweeps/s)|(?<=  size        )[\d,]+(?= bytes)")
"""What differs from machine to machine: pages have `...` there."""


@dataclass(frozen=True, slots=True)
class Example:
    """A command of a page, what the page says it prints (None where it does not say), and where that stands."""

    command: str
    want: str | None
    span: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Done:
    """An example that has run."""

    example: Example
    code: int
    got: str

    @property
    def holds(self) -> bool:
        """Whether it succeeded and printed what the page says."""
        want = self.example.want
        same = want is None or doctest.OutputChecker().check_output(want, self.got, doctest.ELLIPSIS)
        return same and self.code == 0


def examples(markdown: str) -> Iterator[Example | tuple[str, str]]:
    """The examples of a page in order, and the files between them as (name, text)."""
    for fence in PART.finditer(markdown):
        body, start = fence["body"], fence.start("body")
        if fence["row"]:
            yield from (Example(command, None, fence.span()) for command in IN_ROW.findall(fence["row"]))
        elif fence["file"]:
            yield fence["file"], body
        elif fence["language"] == "console":
            for match in COMMAND.finditer(body):
                span = start + match.start("output"), start + match.end("output")
                yield Example(match["command"].replace("\n> ", "\n"), match["output"], span)
        elif fence["language"] == "sh":
            yield Example(STOPPING + body, None, fence.span())


def demo(folder: Path) -> Path:
    """Do in `folder` what `make demo` does once all is installed; return where the commands of README.md run."""
    (folder / "samples").symlink_to(ROOT / "samples")
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ndemo: ")[2].partition("\n\n")[0]
    lines = [line.strip().removeprefix("@").replace("$(BIN)/", "").replace("$$", "$") for line in recipe.splitlines()[1:]]
    code, printed = in_shell(f"{STOPPING}export PYTHONPATH={shlex.quote(str(ROOT))}\n" + "\n".join(lines), folder)
    if code:
        raise SystemExit(f"make demo: exit code {code}\n{printed}")
    return folder / "demo"


def run(markdown: str, folder: Path) -> Iterator[Done]:
    """Run the examples of a page in `folder`, as a shell there would."""
    for item in examples(markdown):
        if isinstance(item, tuple):
            (folder / item[0]).write_text(item[1], encoding="utf-8")
            continue
        yield Done(item, *outcome(item.command, folder))


def outcome(command: str, folder: Path) -> tuple[int, str]:
    """Return the exit code of a command and what it prints."""
    if (calls := plain_calls(command)) is not None:
        return _here(calls, folder)[:2]
    first = FIRST.fullmatch(command)
    # What reads `-o -` may end before the table does: that takes a process.
    calls = plain_calls(first["call"]) if first and " -o - " not in command else None
    if first is None or calls is None:
        return in_shell(command, folder)
    code, printed, complained = _here(calls, folder, apart=first["joint"] == " | ")
    if first["joint"] == "; ":
        code, more = in_shell(f"(exit {code}); {first['rest']}", folder)
        return code, printed + more
    code, more = in_shell(first["rest"], folder, printed)
    return code, complained + more


def plain_calls(command: str) -> list[list[str]] | None:
    """Return the words of each line where all lines only call `lidarcli` or `python`; None where one needs a shell."""
    unquoted = re.sub(r"'[^']*'|\"[^\"$`\\]*\"|(?<=\s)#.*|\\\n", "", command.removeprefix(STOPPING))
    if re.search(r"[^\w\s./:,=+@%-]", unquoted):
        return None
    lines, line = [], ""
    for part in command.removeprefix(STOPPING).splitlines():
        line += part.removesuffix("\\")
        try:
            words = shlex.split(line, comments=True)
        except ValueError:  # the quotation goes on in the next line
            line += "\n"
            continue
        if not part.endswith("\\"):
            lines += [words] if words else []
            line = ""
    return lines if lines and all(words[0] in ("lidarcli", "python") for words in lines) else None


def in_shell(command: str, folder: Path, given: str = "") -> tuple[int, str]:
    """Run a command in a shell, with `given` as its input; return its exit code and what it prints."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        env={**os.environ, **ENVIRONMENT, "PATH": path},
        input=given,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=HANG,
        check=False,
    )
    return done.returncode, done.stdout


def _here(calls: list[list[str]], folder: Path, apart: bool = False) -> tuple[int, str, str]:
    """Run calls until one fails; return its exit code and what all have printed, with errors `apart` or among it."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    code = 0
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors, contextlib.chdir(folder):
        os.environ.update(ENVIRONMENT)
        time.tzset()
        try:
            for words in calls:
                with _printing_to(output.fileno(), (errors if apart else output).fileno()):
                    code = _call(words)
                if code:
                    break
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.__setitem__(name, value)
            time.tzset()
        return code, _text(output), _text(errors)


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode()


@contextlib.contextmanager
def _printing_to(*files: int) -> Iterator[None]:
    """Let standard output and error lead to files, in the order in which a process of its own would print."""
    kept = os.dup(1), os.dup(2)
    for number, file in enumerate(files, 1):
        os.dup2(file, number)
    try:
        with (
            open(1, "w", encoding="utf-8", closefd=False) as out,
            open(2, "w", 1, encoding="utf-8", closefd=False) as err,
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            yield
    finally:
        for number, file in enumerate(kept, 1):
            os.dup2(file, number)
            os.close(file)


def _call(words: list[str]) -> int:
    """Run one call in this process; return its exit code."""
    program, *arguments = words
    if program == "lidarcli":
        from lidarcli.cli import run as lidarcli

        return lidarcli(arguments)
    kept, sys.argv = sys.argv, arguments if arguments[0] != "-c" else ["-c", *arguments[2:]]
    try:
        if arguments[0] == "-c":
            exec(compile(arguments[1], "-c", "exec"), {"__name__": "__main__"})
        else:
            runpy.run_path(arguments[0], run_name="__main__")
    except Exception:
        traceback.print_exc()
        return 1
    finally:
        sys.argv = kept
    return 0


def renewed(markdown: str, folder: Path) -> str:
    """The page with what its examples print today; what still holds stays as it is."""
    stale = [done for done in run(markdown, folder) if not done.holds]
    for done in stale:
        if done.code:
            raise SystemExit(f"{done.example.command}\nexit code {done.code}\n{done.got}")
    for done in reversed(stale):
        start, end = done.example.span
        markdown = markdown[:start] + VOLATILE.sub("...", done.got) + markdown[end:]
    return markdown
