"""`lidarcli map`: options, outputs and true maps that it refuses before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.maps import DRIVE, Run, names


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        ((), "Missing option '-o' / '--output'"),
        (
            ("-o", "{}/m.xyz"),
            "lidarcli: {}/m.xyz: the suffix of a map has to be one of .yaml, .png, .mcap, .ply, .pcd, .parquet\n",
        ),
        (("-o", "{}/m"), "lidarcli: {}/m: the suffix of a map has to be one of "),
        (("-o", "-"), "lidarcli: -: the suffix of a map has to be one of "),
        (("-o", "{}/m.pgm"), ".parquet; {}/m.yaml comes with a .pgm\n"),
        (
            ("-o", "{}/m.png", "-o", "{}/m.ply", "-o", "{}/m.png"),
            "lidarcli: {}/m.png is to be written twice; give each output a name of its own\n",
        ),
        (
            ("-o", "{}/m.YAML", "-o", "{}/m.yaml"),
            "lidarcli: {}/m.pgm is to be written twice; give each output a name of its own\n",
        ),
        (("-o", "{}/m.yaml", "--resolution", "0.0001"), "'--resolution': 0.0001 is below 0.001."),
        (("-o", "{}/m.ply", "--voxel", "1e-12"), "--voxel: 1e-12 m is less than the least cell of 0.001 m; 0 keeps"),
        (
            ("-o", "{}/m.yaml", "-o", "{}/m.ply", "--max-size", "0.00001"),
            f"lidarcli: {DRIVE}: the map would reach over 9 x 7 m, more than 1e-05 km²: a pose or a range may be far off; "
            "limit the log (--range, --start, --end), take a coarser --resolution, or allow more with --max-size\n",
        ),
    ],
)
def test_what_is_refused(lidarcli: Run, tmp_path: Path, options: tuple[str, ...], cause: str) -> None:
    ran = lidarcli("map", DRIVE, *(option.replace("{}", str(tmp_path)) for option in options))
    assert (ran.code, ran.out) == (2, "")
    assert cause.replace("{}", str(tmp_path)) in ran.err
    assert names(tmp_path) == []


@pytest.mark.parametrize("there", ["m.yaml", "m.pgm", "m.ply"])
def test_what_exists_is_not_replaced_unasked(lidarcli: Run, tmp_path: Path, there: str) -> None:
    (tmp_path / there).write_text("mine")
    words = ("map", DRIVE, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.ply")
    ran = lidarcli(*words)
    assert (ran.code, ran.err) == (
        5,
        f"lidarcli: {tmp_path / there} exists; use --overwrite to replace it, or -o to write elsewhere\n",
    )
    assert (names(tmp_path), (tmp_path / there).read_text()) == ([there], "mine")
    assert lidarcli("-q", *words, "--overwrite").code == 0
    assert names(tmp_path) == ["m.pgm", "m.ply", "m.yaml"]
