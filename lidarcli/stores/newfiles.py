"""Files for a store: written on this machine, and put under their final names when all of them are whole."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from lidarcli.newfiles import scratch_folder
from lidarcli.stores.store import put
from lidarcli.stores.url import Url
from lidarcli.threads import Beside


class StoreFiles:
    """As `newfiles.NewFiles`: objects of one folder that get their names together. What may not be replaced was refused
    before; of two runs that write the same object the last one stays, as a whole.
    """

    def __init__(self, paths: Sequence[Url]) -> None:
        self.paths = tuple(paths)
        self._stack = ExitStack()
        self._scratch = Path()

    def part(self, path: Url) -> Path:
        """Where to write the file that will be `path`."""
        return self._scratch / path.name

    def open(self) -> None:
        """Make the folder for the parts."""
        self._scratch = self._stack.enter_context(scratch_folder(Path(tempfile.gettempdir())))

    def publish(self) -> list[str]:
        """Put all files into the store; `OutputError` where it refuses one."""
        # Not in this thread, where an interrupt would come between two files.
        beside = Beside("put")
        try:
            beside.submit(self._put).result()
        finally:
            beside.close()
        return []

    def _put(self) -> None:
        for path in self.paths:
            put(self.part(path), path)

    def close(self) -> None:
        """Remove the files of this machine."""
        self._stack.close()

    def __enter__(self) -> Self:
        try:
            self.open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()
