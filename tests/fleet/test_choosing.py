"""Which logs a run is about."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.pipeline.inputs.search import choose, is_in_shard
from lidarcli.pipeline.inputs.sources import Source
from tests.conftest import Ran
from tests.places import SAMPLES


def names(found: list[object]) -> list[str]:
    return [source.name for source in found if isinstance(source, Source)]


def test_a_list_adds_to_what_is_named(bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    listed = tmp_path / "list.txt"
    listed.write_bytes(b"# new ones\nbags/two.mcap\r\n\nbags/a\n")
    assert names(choose([str(bags / "one.mcap")], str(listed))) == ["one", "two", "run"]


def test_a_list_comes_from_standard_input(bags: Path, process: Callable[..., object], tmp_path: Path) -> None:
    ran = process("detect", "--files-from", "-", "-o", tmp_path / "out", input=f"{bags}/one.mcap\n".encode())
    assert ran.returncode == 0, ran.stderr  # type: ignore[attr-defined]
    assert (tmp_path / "out" / "one.objects.parquet").exists()


def test_a_list_that_is_not_there_is_one_line(lidarcli: Callable[..., Ran], tmp_path: Path) -> None:
    ran = lidarcli("detect", "--files-from", tmp_path / "none.txt")
    assert ran.code == 3
    assert ran.err == f"lidarcli: {tmp_path}/none.txt: cannot be read: No such file or directory\n"


def test_logs_keep_their_place_below_a_base(bags: Path) -> None:
    found = choose([str(bags / "a" / "run.mcap"), str(bags / "b" / "run.mcap")], base=str(bags))
    assert names(found) == ["a/run", "b/run"]
    with pytest.raises(OptionError, match="is not below --base"):
        choose([str(bags / "one.mcap")], base=str(bags / "a"))


def test_logs_keep_their_place_below_a_pattern(bags: Path) -> None:
    assert names(choose([f"{bags}/*/run.mcap"])) == ["a/run", "b/run"]
    assert names(choose([f"{bags}/**/*.mcap"])) == ["a/run", "b/run", "four", "one", "three", "two"]


def test_shares_are_all_logs_once_and_stay_when_logs_come(bags: Path, small: bytes) -> None:
    shares = [set(names(choose([str(bags)], shard=(number, 3)))) for number in (1, 2, 3)]
    assert sorted(name for share in shares for name in share) == sorted(names(choose([str(bags)])))
    (bags / "five.mcap").write_bytes(small)
    later = [set(names(choose([str(bags)], shard=(number, 3)))) for number in (1, 2, 3)]
    assert [share - {"five"} for share in later] == shares


def test_shares_are_of_like_size() -> None:
    counts = [sum(is_in_shard(f"run{k}", (number, 8)) for k in range(8000)) for number in range(1, 9)]
    assert sum(counts) == 8000
    assert all(900 < count < 1100 for count in counts)


@pytest.mark.parametrize("share", ["0/4", "5/4", "1", "a/b", "1/0"])
def test_a_share_that_is_none_is_refused(share: str, lidarcli: Callable[..., Ran]) -> None:
    assert lidarcli("detect", "x.mcap", "--shard", share).code == 2


def test_something_has_to_be_named(lidarcli: Callable[..., Ran]) -> None:
    ran = lidarcli("detect")
    assert ran.code == 2
    assert "Missing argument 'LOG...'" in ran.err


def test_a_list_of_nothing_is_told(tmp_path: Path) -> None:
    with pytest.raises(UnreadableError, match=r"cannot be read: Is a directory"):
        choose([], str(tmp_path))


def test_a_dry_run_says_what_it_would_do_and_does_nothing(
    bags: Path, tmp_path: Path, lidarcli: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    size = (bags / "one.mcap").stat().st_size
    ran = lidarcli("detect", "bags/one.mcap", "none.mcap", "-o", "out", "--dry-run")
    assert ran.out.splitlines() == [
        f"read   bags/one.mcap ({size:,} bytes)",
        "write  out/one.objects.parquet",
        "write  out/one.sweeps.parquet",
        "fail   none.mcap: no such file or folder",
    ]
    assert ran.code == 3
    assert not (tmp_path / "out").exists()
    assert lidarcli("detect", "bags/one.mcap", "-o", "out").code == 0
    again = lidarcli("detect", "bags/one.mcap", "-o", "out", "--dry-run")
    assert again.code == 5
    assert "write  out/one.objects.parquet (exists; refused without --overwrite)" in again.out
    replaced = lidarcli("detect", "bags/one.mcap", "-o", "out", "--dry-run", "--overwrite")
    assert (replaced.code, replaced.out.count("(is replaced)")) == (0, 2)


@pytest.mark.parametrize("arguments", [("info",), ("map", "-o", "map.yaml"), ("background", "build", "-o", "b.parquet")])
def test_others_say_what_they_would_read(
    arguments: tuple[str, ...], bags: Path, lidarcli: Callable[..., Ran], tmp_path: Path
) -> None:
    listed = tmp_path / "list.txt"
    listed.write_text(f"{bags}/one.mcap\n")
    ran = lidarcli(*arguments, "--files-from", listed, "--dry-run")
    assert ran.code == 0
    assert ran.out.startswith(f"read   {bags}/one.mcap")
    assert ran.err == ""


@pytest.mark.parametrize(
    ("data", "cause"),
    [(b"one.mcap\0two.mcap\0", "it holds NUL bytes"), ("one.mcap\n".encode("utf-16"), "it holds NUL bytes")],
)
def test_a_list_that_is_none(data: bytes, cause: str, tmp_path: Path, lidarcli: Callable[..., Ran]) -> None:
    (tmp_path / "list").write_bytes(data)
    ran = lidarcli("detect", "--files-from", tmp_path / "list", "-o", tmp_path / "out")
    assert (ran.code, len(ran.err.splitlines())) == (3, 1)
    assert cause in ran.err


def test_what_a_list_names_in_vain_is_told_with_its_line(bags: Path, tmp_path: Path, lidarcli: Callable[..., Ran]) -> None:
    listed = tmp_path / "list.txt"
    listed.write_bytes(b"\xef\xbb\xbf" + f"{bags}/one.mcap\n\nnone.mcap\n".encode())
    ran = lidarcli("detect", "--files-from", listed, "-o", tmp_path / "out")
    assert ran.code == 3
    assert f"lidarcli: {listed}: line 3: none.mcap: no such file or folder\n" in ran.err
    assert (tmp_path / "out" / "one.objects.parquet").exists()


def test_nothing_to_do_is_told(tmp_path: Path, lidarcli: Callable[..., Ran]) -> None:
    (tmp_path / "list").touch()
    ran = lidarcli("detect", "--files-from", tmp_path / "list", "-o", tmp_path / "out")
    assert (ran.code, ran.err) == (0, "0 logs\n")


def test_a_log_is_not_below_itself(bags: Path) -> None:
    with pytest.raises(OptionError, match="is not below --base"):
        choose([str(bags / "one.mcap")], base=str(bags / "one.mcap"))
    (bags / "..odd").mkdir()
    (bags / "one.mcap").rename(bags / "..odd" / "one.mcap")
    assert names(choose([str(bags / "..odd" / "one.mcap")], base=str(bags))) == ["..odd/one"]


def test_a_log_that_a_pattern_names_twice_is_one(bags: Path) -> None:
    shutil.copytree(SAMPLES / "hall", bags / "hall")
    found = choose([f"{bags}/**"])
    assert sorted(names(found)) == ["a/run", "b/run", "four", "hall", "one", "three", "two"]
    assert len(found) == 7
