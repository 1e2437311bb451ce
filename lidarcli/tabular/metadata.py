"""What a table says of its own making, in its schema metadata.

There is no clock and no host in it: the same input and parameters give the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from lidarcli._version import __version__

VERSION, PARAMETERS, SOURCE, DAMAGE = (
    "lidarcli.version",
    "lidarcli.parameters",
    "lidarcli.source",
    "lidarcli.damage",
)


def table_metadata(
    parameters: Mapping[str, Any],
    source: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    damage: Sequence[str] = (),
) -> dict[bytes, bytes]:
    """Schema metadata: version, parameters, source (name, size, format) and, only when there is any, damage.

    >>> table_metadata({"b": 1, "a": None})[b"lidarcli.parameters"]
    b'{"a": null, "b": 1}'
    """
    entries = {VERSION: __version__, PARAMETERS: _json(parameters)}
    if source is not None:
        entries[SOURCE] = _json(source)
    if damage:
        entries[DAMAGE] = _json(list(damage))
    # Names of files need not be UTF-8, but what Arrow keeps must be.
    return {key.encode(): value.encode(errors="replace") for key, value in entries.items()}


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, ensure_ascii=False)
