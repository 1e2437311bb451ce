"""TOML files that a user wrote: read within bounds, with one clear line for whatever is wrong with them."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lidarcli.errors import UnreadableError

MAX_BYTES = 1_000_000
"""Most bytes of a file."""
MAX_DEPTH = 16
"""Most levels of brackets, and of the parts of a dotted key."""
_TEXTS = re.compile(r""""(?:\\.|[^"\\\n])*"?|'[^'\n]*'?|\#[^\n]*""")
_BETWEEN_KEYS = re.compile(r"[^\w \t.-]")


Judge = Callable[[os.stat_result], None]
"""Raises an error where a file of such an owner and mode is not to be read."""


def read_toml(file: str, what: str, judge: Judge | None = None) -> dict[str, Any]:
    """The document of a TOML file, which errors call a `what` (scene, catalogue); `judge` sees the file once it is open."""
    text = _text(file, what, judge)
    _refuse_nested(file, text)
    try:
        return tomllib.loads(text)
    except ValueError as err:
        raise UnreadableError(f"{file}: not valid TOML: {err}") from err


def _text(file: str, what: str, judge: Judge | None) -> str:
    """The text of the file."""
    try:
        with Path(file).open("rb") as opened:
            if judge is not None:
                judge(os.fstat(opened.fileno()))
            data = opened.read(MAX_BYTES + 1)
    except OSError as err:
        raise UnreadableError(f"{file}: cannot read the {what}: {err.strerror or err}") from err
    if len(data) > MAX_BYTES:
        raise UnreadableError(f"{file}: larger than a {what} may be ({MAX_BYTES:,} bytes)")
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as err:
        raise UnreadableError(f"{file}: byte {err.start}: not UTF-8 text; a {what} is a TOML file") from err


def _refuse_nested(file: str, text: str) -> None:
    """Refuse what would take the parser more memory than the file is worth."""
    for number, line in enumerate(_lines_without_texts(text), 1):
        if any(part.count(".") > MAX_DEPTH for part in _BETWEEN_KEYS.split(line)):
            raise UnreadableError(f"{file}: line {number}: a key of more than {MAX_DEPTH} parts")
    depth = 0
    for number, line in enumerate(_lines_without_texts(text), 1):
        for mark in line:
            depth += (mark in "[{") - (mark in "]}")
            if depth > MAX_DEPTH:
                raise UnreadableError(f"{file}: line {number}: more than {MAX_DEPTH} brackets are open")


def _lines_without_texts(text: str) -> list[str]:
    """Lines with a letter in place of each text, and without comments."""
    return _TEXTS.sub("x", text).split("\n")
