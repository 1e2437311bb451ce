"""Names that a store allows and that stand for no place: each is told, none is left out in silence."""

from __future__ import annotations

import pytest

from lidarcli.display.credentials import blotted
from lidarcli.files.stores import State, Url
from lidarcli.pipeline.inputs import search
from lidarcli.pipeline.inputs.sources import Source


def test_keys_that_stand_for_no_place_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    base = Url("s3", "b", "logs")
    usable = {"a.mcap": True, "day//d.mcap": False, "e.mcap?token=x.mcap": False}
    objects = [(base / name, State(1, 1)) for name in (*usable, ".hidden/f.mcap", "day/notes.md")]
    monkeypatch.setattr(search, "listing", lambda _: iter(objects))
    found = search.find_logs([f"{base}/"])
    assert {each.path: isinstance(each, Source) for each in found} == {
        f"{base}/{name}": is_one for name, is_one in usable.items()
    }


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("https://user:pass@host/x: gone", "https://...@host/x: gone"),
        ("https:/user:pa/ss@host/x", "https:/...@host/x"),
        ("https://TOKEN@host/x", "https://...@host/x"),
        ("image s3://AK:S/K@b/x.pgm is no file", "image s3://...@b/x.pgm is no file"),
        ("s3://b/x?aws_secret_access_key=K&region=r", "s3://b/x?aws_secret_access_key=...&region=r"),
        ("x?AWSAccessKeyId=A&X-Amz-Signature=B", "x?AWSAccessKeyId=...&X-Amz-Signature=..."),
        ("AccountKey=abc==;Endpoint=e", "AccountKey=...;Endpoint=e"),
        ("s3://anonymous@b/key=5/x", "s3://anonymous@b/key=5/x"),
        ("abfs://c@a.dfs.core.windows.net/run key=1.mcap", "abfs://c@a.dfs.core.windows.net/run key=1.mcap"),
        ("tcp://host:8786: a@b", "tcp://host:8786: a@b"),
    ],
)
def test_credentials_are_left_out(text: str, shown: str) -> None:
    assert blotted(text) == shown


def test_a_name_of_any_length_is_searched_for_credentials_in_time() -> None:
    # Where the time grew with the square of the length, this took half a minute; it takes a fraction of a second.
    for part in ("a", "a:/", "a:/:::", "?sig", "x-amz-"):
        text = part * (40_000 // len(part))
        assert blotted(text) == text
