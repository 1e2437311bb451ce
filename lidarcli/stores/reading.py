"""An object as a file that is read here and there: it comes in large pieces, each of them once."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
from pathlib import Path
from typing import IO, TYPE_CHECKING

from lidarcli.machine import Threads
from lidarcli.stores.url import PIECE, Url, open_object

if TYPE_CHECKING:
    from concurrent.futures import Future


class StoreFile(io.RawIOBase):
    """A read-only file whose bytes are fetched as they are asked for, `PIECE` at a time.

    Who reads piece after piece gets the next one fetched beside.

    Raises
    ------
    UnreadableError
        There is no such object, or the store does not hand it out.
    """

    def __init__(self, url: Url) -> None:
        super().__init__()
        self._object = open_object(url)
        self.name = str(url)
        self.size: int = self._object.size()
        self._position = 0
        self._copy: IO[bytes] | None = None
        self._kept = bytearray(self.size // PIECE + 1)
        self._last: tuple[int, bytes] = (-1, b"")
        self._beside: Threads | None = None
        self._ahead: tuple[int, Future[bytes]] | None = None

    def keep(self) -> None:
        """Keep pieces in a temporary file from now on.

        A log that is read twice, for its poses and for its sweeps, is then fetched once. Pieces for which the disk has no
        room are fetched again.
        """
        self._copy = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
        if self._last[0] >= 0:
            self._keep(*self._last)

    def readable(self) -> bool:
        """Always."""
        return True

    def seekable(self) -> bool:
        """Always."""
        return True

    def tell(self) -> int:
        """Return the position of the next bytes."""
        return self._position

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go elsewhere."""
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self.size}[whence]
        self._position = max(0, base + offset)
        return self._position

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Fill the buffer up to the end of a piece."""
        number, offset = divmod(self._position, PIECE)
        wanted = min(len(buffer), PIECE - offset, self.size - self._position)
        if wanted <= 0:
            return 0
        if self._copy is not None and self._kept[number]:
            data = os.pread(self._copy.fileno(), wanted, self._position)
        else:
            data = self._piece(number)[offset : offset + wanted]
        buffer[: len(data)] = data
        self._position += len(data)
        return len(data)

    def close(self) -> None:
        """Let go of the object, and of what was kept of it."""
        if not self.closed:
            if self._beside is not None:
                self._beside.close()
            if self._copy is not None:
                self._copy.close()
            self._object.close()
        super().close()

    def _piece(self, number: int) -> bytes:
        """Return a piece, from the last one, from ahead or fetched."""
        if self._last[0] == number:
            return self._last[1]
        in_order = number == self._last[0] + 1
        if self._ahead is not None and self._ahead[0] == number:
            data = self._ahead[1].result()
            self._ahead = None
        else:
            data = self._fetch(number)
        self._last = number, data
        self._keep(number, data)
        if in_order and (number + 1) * PIECE < self.size and not self._kept[number + 1]:
            self._fetch_ahead(number + 1)
        return data

    def _fetch(self, number: int) -> bytes:
        data = bytes(self._object.read_at(PIECE, number * PIECE))
        if len(data) < min(PIECE, self.size - number * PIECE):
            raise OSError(f"the object ends at byte {number * PIECE + len(data):,}: it was replaced meanwhile")
        return data

    def _fetch_ahead(self, number: int) -> None:
        try:
            if self._beside is None:
                self._beside = Threads("fetch")
            self._ahead = number, self._beside.submit(self._fetch, number)
        except RuntimeError:
            # The system has no thread to give; it goes without.
            self._ahead = None

    def _keep(self, number: int, data: bytes) -> None:
        if self._copy is None:
            return
        try:
            view, at = memoryview(data), number * PIECE
            while view:
                written = os.pwrite(self._copy.fileno(), view, at)
                view, at = view[written:], at + written
        except OSError:
            # No room on the disk: what is there stays there, the rest is fetched whenever it is asked for.
            return
        self._kept[number] = 1


def fetch(url: Url, path: Path) -> None:
    """Copy an object into a file of this machine; errors as of `StoreFile`."""
    with StoreFile(url) as source, path.open("wb") as copy:
        shutil.copyfileobj(source, copy, PIECE)
