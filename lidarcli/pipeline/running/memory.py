"""How this process asks the system for memory."""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Names of settings, as malloc.h of the GNU C library numbers them."""
_KEPT, _LARGE = 256 << 20, 32 << 20


def keep_freed_memory() -> None:
    """Let the allocator keep what is freed, where it can be told to: for programs of our own, not for those of others.

    A batch allocates and frees the same arrays as the one before. By default they go back to the system in between and
    come anew, page by page, which takes up to a tenth of the whole time.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):
        # Another C library, or another system.
        return
    mallopt(_TRIM_THRESHOLD, _KEPT)
    mallopt(_MMAP_THRESHOLD, _LARGE)
