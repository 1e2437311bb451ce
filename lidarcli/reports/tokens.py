"""The words of a check: numbers, names, operators, quoted texts."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lidarcli.errors import OptionError

_TOKEN = re.compile(
    r"""\s*(?:
    (?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.]))
  | (?P<name>[A-Za-z_][\w]*(?:\.[A-Za-z_]\w*)*)
  | (?P<operator>==|!=|<=|>=|<|>)
  | (?P<bracket>[()])
  | "(?P<double>[^"]*)" | '(?P<single>[^']*)'
    )""",
    re.VERBOSE,
)
LONGEST_CHECK = 10_000
"""Most characters of a check."""
SHOWN_OF_CHECK = 200
"""Most characters of it that an error repeats."""


@dataclass(frozen=True, slots=True)
class Token:
    """One word of a check and where it begins."""

    kind: str
    """`number`, `name`, `operator`, `bracket`, `text` or `end`."""
    text: str
    place: int


class Tokens:
    """The words of one check, read from left to right."""

    def __init__(self, expression: str) -> None:
        self.expression = expression
        if len(expression) > LONGEST_CHECK:
            raise OptionError(
                f"--check '{expression[:20]}...': {len(expression):,} characters are more than a check may have "
                f"({LONGEST_CHECK:,})"
            )
        self._all = self._split()
        self._at = 0

    @property
    def next(self) -> Token:
        """The word that comes next."""
        return self._all[self._at]

    @property
    def after_next(self) -> Token:
        """The word after that."""
        return self._all[min(self._at + 1, len(self._all) - 1)]

    def take(self) -> Token:
        """The next word, which is then behind us."""
        token = self.next
        self._at = min(self._at + 1, len(self._all) - 1)
        return token

    def take_if(self, *texts: str) -> str | None:
        """The next word if it is one of these keywords or signs."""
        if self.next.kind in ("name", "operator", "bracket") and self.next.text in texts:
            return self.take().text
        return None

    def expect(self, kind: str, wanted: str) -> Token:
        """The next word, which has to be of this kind."""
        if self.next.kind != kind:
            raise self.error(f"expected {wanted}")
        return self.take()

    def error(self, problem: str, token: Token | None = None) -> OptionError:
        """The error of this check at the next word, or at the one given."""
        at = token or self.next
        where = "at the end" if at.kind == "end" else f"at '{at.text}', column {at.place + 1}"
        shown = (
            self.expression
            if len(self.expression) <= SHOWN_OF_CHECK
            else f"{self.expression[:SHOWN_OF_CHECK]}..."
        )
        return OptionError(f"--check '{shown}': {problem} {where}")

    def _split(self) -> list[Token]:
        text, place, found = self.expression.rstrip(), 0, []
        while place < len(text):
            match = _TOKEN.match(text, place)
            if match is None:
                start = place + len(text[place:]) - len(text[place:].lstrip())
                raise self.error("cannot be read", Token("unknown", text[start], start))
            kind = str(match.lastgroup)
            found.append(
                Token("text" if kind in ("double", "single") else kind, match[kind], match.start(kind))
            )
            place = match.end()
        return [*found, Token("end", "", len(self.expression))]
