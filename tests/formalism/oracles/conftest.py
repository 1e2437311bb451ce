"""Leave this folder out while the core is compiled: compiled modules do not show their steps."""

from __future__ import annotations

from lidarcli.system import compiled

collect_ignore_glob = ["*.py"] if compiled.is_there() and compiled.is_wanted() else []
