"""Options that do nothing: each is refused, or a note says so; and what stands in place of a value is no value."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

from lidarcli.cli.declared import DeclaredOption
from lidarcli.cli.main import COMMANDS, cli
from lidarcli.options.forms import File, Text, options_of
from lidarcli.options.reading import Ranges, Reading
from lidarcli.options.values import CLOUDS, GEOMETRY
from lidarcli.simulation.writers import write_log
from tests.sweeping import room_sweeps

OPTIONS = [
    (name, option)
    for name in COMMANDS
    for option in getattr(cli.get_command(click.Context(cli), name), "params", ())
    if isinstance(option, DeclaredOption) and isinstance(option.declared.value, Text | File)
]


@pytest.mark.parametrize(("command", "option"), OPTIONS, ids=[f"{name} {option.key}" for name, option in OPTIONS])
def test_an_option_is_no_value(command: str, option: DeclaredOption, lidarcli: Callable[..., Any]) -> None:
    value = option.declared.value
    ran = lidarcli(command, f"--{option.key}", "--overwrite")
    assert ran.code == 2
    assert option.key in ran.err or "Missing" in ran.err
    if isinstance(value, Text) and not value.is_list and option.declared.alone is None:
        assert lidarcli(command, f"--{option.key}", "").code == 2


GIVEN = {
    "columns": "time,ranges",
    "angle_min": "-1",
    "angle_increment": "0.01",
    "fov": "3",
    "range_max": "9",
    "degrees": None,
    "echo": "last",
    "pose_delay": "0.2",
    "deskew": None,
    "beam_order": "once",
}
"""Options of reading that some logs have no use for, with a value."""
EFFECT = {"degrees", "range_unit"}
"""Those that every LaserScan of ROS has a use for."""


def spelled(name: str) -> list[str]:
    option, value = options_of(Reading)[name], GIVEN[name]
    words = f"--{'no-' * option.is_negated}{name.replace('_', '-')}"
    return [words] if value is None else [words, value]


def test_every_option_of_reading_is_tried() -> None:
    """Those of geometry and of poses; others are refused by rules of their own, or hold for every log."""
    geometry = {name for name, option in options_of(Ranges).items() if option.heading == GEOMETRY}
    assert geometry <= GIVEN.keys() | EFFECT
    assert {name for name, option in options_of(Ranges).items() if option.heading == CLOUDS} == {"slice", "bins"}


CASES = [
    (command, name, suffix)
    for command in ("detect", "info")
    for name in GIVEN
    for suffix in (".mcap", ".bag", ".db3", ".csv")
    # A CSV takes names for its columns.
    if name not in EFFECT and (name, suffix) != ("columns", ".csv")
]


@pytest.mark.parametrize(("command", "name", "suffix"), CASES)
def test_an_option_without_effect_is_told(
    command: str, name: str, suffix: str, lidarcli: Callable[..., Any], tmp_path: Path
) -> None:
    log = tmp_path / f"run{suffix}"
    write_log(log, [room_sweeps()])
    own = ["-o", tmp_path / "tables", "--overwrite"] if command == "detect" else []
    ran = lidarcli(command, log, *own, *spelled(name))
    assert ran.code == 0
    told = " ".join((ran.out + ran.err).split())
    assert f"no effect on this log: {spelled(name)[0]}" in told or f"no poses in this log: {spelled(name)[0]}" in told
    plain = lidarcli(command, log, *own)
    assert "no effect" not in plain.out + plain.err


def test_degrees_of_a_log_of_bearings(lidarcli: Callable[..., Any], tmp_path: Path) -> None:
    """A column that tells its unit needs no option, one that does not is taken for degrees."""
    for name, is_told in (("angle_deg", True), ("angle", False)):
        (tmp_path / "run.csv").write_text(f"{name},range\n" + "".join(f"{a / 10},2.5\n" for a in range(40)))
        ran = lidarcli("info", tmp_path / "run.csv", "--degrees")
        assert ("no effect on this log: --degrees" in ran.out) is is_told
        assert "view 3.90 deg" in " ".join(ran.out.split())
