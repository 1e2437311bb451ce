"""Changes to texts, word by word: numbers that lie, lines twice or gone, brackets without an end."""

from __future__ import annotations

import re

from tools.fuzz.target import Random

_WORD = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?|[\w/.]+|[^\w\s]|\s+")
_NUMBERS = (
    *("0", "-1", "1e308", "-1e308", "1e-320", "inf", "nan", "9223372036854775807", "-9223372036854775808"),
    *("99999999999999999999", "1e400", "0.0", "2147483648", "true", '"1"', "[]", "{}", "1_0", "0x7f"),
)
_TEXTS = (
    *('""', "'", '"', "\x00", "\x1b[31m", "\u202e", "a" * 3000, "../../thesis", "~", "- ", "!!python", "&a", "*a"),
    *("[" * 200, "{" * 200, "# ", "\r", "\ufeff", "<b>", "]]>"),
)
_MOST = 64
"""Repeats of a line or a word."""


def mutate_words(text: str, random: Random) -> str:
    """The text after one to five changes; the same generator state gives the same text."""
    for _ in range(int(random.integers(1, 6))):
        text = _lines(text, random) if not random.integers(3) else _words(text, random)
    return text


def _words(text: str, random: Random) -> str:
    words = _WORD.findall(text)
    if not words:
        return text
    at = int(random.integers(len(words)))
    other = words[int(random.integers(len(words)))]
    odd = (_NUMBERS, _TEXTS)[int(random.integers(2))]
    changes = (odd[int(random.integers(len(odd)))], other, "", words[at] * int(random.integers(2, _MOST)))
    words[at] = changes[int(random.integers(len(changes)))]
    return "".join(words)


def _lines(text: str, random: Random) -> str:
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    at = int(random.integers(len(lines)))
    kind = int(random.integers(4))
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines[at:at] = [lines[at]] * int(random.integers(1, _MOST))
    elif kind == 2:
        lines.insert(int(random.integers(len(lines))), lines.pop(at))
    else:
        lines = lines[:at]
    return "".join(lines)
