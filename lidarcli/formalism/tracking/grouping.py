"""Bodies that are one thing: legs that go together, and pieces of a track before and after a gap."""

from __future__ import annotations

from typing import Any

from lidarcli.formalism.tracking.things import Thing


def join(seen: Any, things: dict[int, Thing], begin: int, stop: int) -> None:
    """Let the bodies that are new in a window become parts of tracks, where they are."""
