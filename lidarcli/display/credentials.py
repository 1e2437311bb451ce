"""Texts without the credentials that URLs and messages of stores hold."""

from __future__ import annotations

import re

SECRETS = (
    r"(?i)([?&](?:x-amz-[a-z-]+|[\w-]*(?:sig|signature|token|secret|password|key)(?:[_-]?id)?)="
    r"|\b(?:sig|signature|token|secret|password|accountkey)=)[^&;:\s\"']+"
)
"""Credentials in the query of a URL, and as stores name them in their messages."""

_USER = r"([A-Za-z][A-Za-z0-9+.-]{0,30}):(//?)([^\s/@:]{0,2000}+(?::[^\s@]{0,2000}+)?)@"
"""A URL up to the end of its user; a password may hold slashes, and a path has lost one. Lengths have limits: a log may
hold names of any length, and without it the time to search them grows with the square of theirs."""


def blotted(text: str) -> str:
    """Return a text without credentials.

    >>> blotted("https://me:pass@host/x?aws_secret_access_key=K: no such file")
    'https://...@host/x?aws_secret_access_key=...: no such file'
    """
    return re.sub(SECRETS, r"\1...", without_users(text))


def without_users(text: str) -> str:
    """Return a text whose URLs name no user and no password."""
    return re.sub(_USER, _without_user, text)


def _without_user(found: re.Match[str]) -> str:
    scheme, name = found[1].lower(), found[3]
    # Nobody in particular, and the container of an account of Azure, are no secret.
    known = scheme in ("s3", "gs") if name == "anonymous" else scheme in ("az", "abfs", "abfss")
    return found[0] if known and ":" not in name else f"{found[1]}:{found[2]}...@"
