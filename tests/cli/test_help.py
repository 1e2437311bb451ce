"""What help, completion and options say; options that do nothing are refused."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
import pyarrow as pa
import pytest

import lidarcli as package
from lidarcli.cli.commands import COMMANDS, cli
from lidarcli.cli.declared import DeclaredOption
from lidarcli.formalism import Parameters
from lidarcli.options.forms import File, Text, options_of
from lidarcli.options.groups import LearningGroup, MappingGroup, Plotting, Reporting
from lidarcli.options.objects import Tabling
from lidarcli.options.reading import GEOMETRY, POINT_CLOUDS, Ranges, ReadingGroup, parse_no_return
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.system.compiled import about_core
from tests.places import SAMPLES
from tests.sweeping import room_sweeps
from tools.reference import commands

Run = Callable[..., Any]


def options(name: str) -> dict[str, click.Option]:
    command = cli.get_command(click.Context(cli, **cli.context_settings), name)
    assert command is not None
    return {
        spelling: parameter
        for parameter in command.params
        if isinstance(parameter, click.Option)
        for spelling in parameter.opts
    }


SCREENS = 60
"""Most lines of a help at 80 columns: a screen and a half."""


@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_and_shows_defaults(lidarcli: Run, name: str) -> None:
    ran = lidarcli(name, "--help", code=0)
    lines = ran.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= SCREENS
    assert "Examples:" in ran.out or "Commands:" in ran.out
    for option in options(name).values():
        documented = option.is_flag or option.required or option.show_default or "default" in (option.help or "")
        # What is off unless it is given has no default to show.
        optional = ("fov", "angle_increment", "limits", "background")
        assert option.help, option.name
        assert documented or option.name in optional, option.name


def test_defaults_in_help_are_those_of_the_profiles() -> None:
    shown = {name: options("detect")[name].help or "" for name in ("--min-beams", "--max-width", "--max-gap")}
    robust, paper = Parameters.for_profile("robust"), Parameters.for_profile("paper")
    assert f"[default: {robust.min_beams}; paper: {paper.min_beams}]" in shown["--min-beams"]
    assert f"[default: {robust.max_width:g}; paper or --background: no limit]" in shown["--max-width"]
    assert f"[default: {robust.max_gap}; paper: {paper.max_gap}]" in shown["--max-gap"]
    assert (robust.threshold, paper.threshold, robust.group_gap) == ("adaptive", "mean", 0)
    words, markers = parse_no_return(str(options("detect")["--no-return"].default))
    assert (words, markers) == (RangeRules().no_return, RangeRules().markers)


def test_commands_and_version(lidarcli: Run) -> None:
    ran = lidarcli("--help")
    assert [line.split()[0] for line in ran.out.split("Commands:\n")[1].split("\n\n")[0].splitlines()] == [*COMMANDS]
    # The summary of each command fits whole.
    assert max(map(len, ran.out.splitlines())) <= 80
    assert "...\n" not in ran.out.split("Commands:\n")[1]


def test_version_tells_what_a_report_of_a_bug_needs(lidarcli: Run) -> None:
    text = lidarcli("--version").out
    assert max(map(len, text.splitlines())) < 80
    first, *rest = text.replace("\n" + " " * 13, " ").splitlines()
    assert first == f"lidarcli {package.__version__}"
    told = {line.split()[0]: line.split(maxsplit=1)[1] for line in rest}
    assert told["core"] == about_core()
    assert told["system"].startswith(f"Python {platform.python_version()}, ")
    assert f"numpy {np.__version__}" in told["libraries"].split(", ")
    assert f"pyarrow {pa.__version__}" in told["libraries"].split(", ")


HEAVY = ("numpy", "pandas", "pyarrow", "mcap", "rosbags", "rich", "matplotlib")
IMPORTED = f"import sys; print(*[name for name in {HEAVY!r} if name in sys.modules])"


@pytest.mark.parametrize(
    "code",
    [
        "import lidarcli",
        "import lidarcli.cli",
        "from lidarcli.cli import run; run(['--help'])",
        "from lidarcli.cli import run; run(['detect', '--help'])",
        "from lidarcli.cli import run; run(['simulate', '--help'])",
    ],
)
def test_nothing_heavy_is_imported(code: str) -> None:
    ran = subprocess.run([sys.executable, "-c", f"{code}; {IMPORTED}"], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == ""


NEVER = ("pandas", "pyarrow.acero", "pyarrow.dataset")
"""Modules that take long to import, and that no command needs."""


@pytest.mark.parametrize(
    ("words", "others"),
    [
        ("detect room.mcap -o new", ("rich", "numpy.ma", "pyarrow.compute")),
        ("track drive.db3 -o new", ("rich", "matplotlib")),
        ("overlay drive.db3 -o new.mcap", ("rich", "matplotlib")),
        ("report tables/drive.objects.parquet", ("matplotlib", "jinja2")),
        ("report tables/drive.objects.parquet -o new.html --log drive.db3", ()),
        ("plot drive.db3 -o new.png", ("rich", "pyarrow")),
        ("plot drive.db3 -o new.gif --animate --sweeps 0:3 --view scene", ("pyarrow",)),
        ("plot drive.db3 -o new.png --tracks tables/drive.tracks.parquet", ("rich",)),
        ("map drive.db3 -o new.yaml", ("rich", "matplotlib", "pyarrow.compute")),
        ("map drive.db3 -o new.png", ("rich", "pyarrow.compute")),
    ],
)
def test_a_command_imports_nothing_that_it_does_not_use(
    tmp_path: Path, lidarcli: Run, words: str, others: tuple[str, ...]
) -> None:
    for name in ("room.mcap", "drive.db3"):
        (tmp_path / name).symlink_to(SAMPLES / name)
    if "tables/" in words:
        lidarcli("track", tmp_path / "drive.db3", "-o", tmp_path / "tables")
    code = (
        f"from lidarcli.cli import run; code = run(['-q', *{words!r}.split()]); "
        f"import sys; print(code, [name for name in {NEVER + others!r} if name in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "0 []"


@pytest.mark.parametrize("name", ["detect", "track", "zones", "background build", "completion"])
def test_help_says_how_many_options_it_leaves_out(lidarcli: Run, name: str) -> None:
    some, all_of_them = (lidarcli(*name.split(), word).out for word in ("--help", "--help-all"))
    shown, there = (set(re.findall(r"^  (?:-\w, )?(--[a-z-]+)", text, re.MULTILINE)) for text in (some, all_of_them))
    assert shown < there
    assert some.splitlines()[-1] == (
        f"  lidarcli {name} --help-all shows {len(there - shown - {'--help', '--help-all'})} more options."
    )
    assert max(map(len, all_of_them.splitlines())) <= 80
    examples, all_examples = (re.findall(rf"^    lidarcli {name}.*", text, re.MULTILINE) for text in (some, all_of_them))
    assert examples == all_examples[: len(examples)]


def test_help_leaves_out_what_only_some_logs_need(lidarcli: Run) -> None:
    rare = {
        name for name, option in options("track").items() if isinstance(option, DeclaredOption) and option.declared.rare
    }
    assert rare >= {
        *("--columns", "--angle-min", "--angle-increment", "--fov", "--range-max", "--degrees", "--range-unit"),
        *("--segments", "--echo", "--bins", "--slice", "--any-frame", "--station-distance", "--station-angle", "--run"),
        *("--threshold", "--min-beams", "--max-gap", "--group-gap", "--profile", "--min-thing", "--walls", "--no-return"),
        *("--beam-order", "--no-deskew", "--pose-delay", "--shard", "--base", "--files-from", "--partition", "--cluster"),
        *("--removed", "--explain"),
    }
    assert rare.isdisjoint({"--output", "--overwrite", "--topic", "--start", "--end", "--pose", "--background", "--mask"})
    ran = lidarcli("detect", "run.mcap", "--range-unti", "mm", code=2)
    assert "--range-unit" in ran.err


def test_an_option_has_the_same_words_everywhere() -> None:
    """What a command fills with something else is named here."""
    of_its_own = {"output", "format", "topic", "background", "tracks", "objects", "layout", "map", "sweeps", "only"}
    of_its_own |= {"brief", "columns", "station_distance", "station_angle", "view", "dpi", "check", "zones", "clips"}
    of_its_own |= {"explain", "every"}
    words: dict[str, set[str]] = {}
    for _, command in commands():
        for parameter in command.params:
            if isinstance(parameter, DeclaredOption) and parameter.field not in of_its_own:
                words.setdefault(parameter.field, set()).add(parameter.declared.help)
    assert {field for field, said in words.items() if len(said) > 1} == set()
    keywords = {
        field: option.help
        for group in (ReadingGroup, Tabling, LearningGroup, MappingGroup, Plotting, Reporting)
        for field, option in options_of(group).items()
        if field not in of_its_own
    }
    # The table of beams that `tables` makes is the one that `detect --beams` writes.
    assert {field: {said} for field, said in keywords.items()} == {field: words[field] for field in keywords}


def completed(*words: str) -> list[str]:
    """The completions of the last of the words, as bash gets them."""
    code = (
        "import sys; from lidarcli.cli import run\n"
        "try: run([])\nexcept SystemExit: pass\n"
        f"print(*[name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code],
        env={
            "_LIDARCLI_COMPLETE": "bash_complete",
            "COMP_WORDS": " ".join(["lidarcli", *words]),
            "COMP_CWORD": str(len(words)),
            "PYTHONPATH": ":".join(sys.path),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stderr.strip() == "", "something heavy was imported"
    return [line.split(",")[1] for line in ran.stdout.splitlines()]


def test_commands_options_and_values_are_completed() -> None:
    assert completed("de") == ["detect"]
    assert completed("background", "") == ["build", "subtract"]
    assert completed("background", "subtract", "--any") == ["--any-frame"]
    assert completed("background", "build", "--station-") == ["--station-distance", "--station-angle"]
    assert completed("detect", "--min-") == ["--min-beams", "--min-thing"]
    assert completed("detect", "--profile", "") == ["robust", "paper"]
    assert completed("completion", "") == ["bash", "zsh", "fish"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_one_that_the_shell_takes(lidarcli: Run, shell: str) -> None:
    ran = lidarcli("completion", shell)
    assert (ran.code, ran.err) == (0, "")
    assert f"_LIDARCLI_COMPLETE={shell}_complete" in ran.out
    if (program := shutil.which(shell)) is not None:
        subprocess.run([program, "-n"], input=ran.out, text=True, check=True)


OPTIONS = [
    (name, option)
    for name in COMMANDS
    for option in getattr(cli.get_command(click.Context(cli), name), "params", ())
    if isinstance(option, DeclaredOption) and isinstance(option.declared.value, Text | File)
]


@pytest.mark.parametrize(("command", "option"), OPTIONS, ids=[f"{name} {option.key}" for name, option in OPTIONS])
def test_an_option_is_no_value(command: str, option: DeclaredOption, lidarcli: Callable[..., Any]) -> None:
    value = option.declared.value
    ran = lidarcli(command, f"--{option.key}", "--overwrite", code=2)
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
    option, value = options_of(ReadingGroup)[name], GIVEN[name]
    words = f"--{'no-' * option.is_negated}{name.replace('_', '-')}"
    return [words] if value is None else [words, value]


def test_every_option_of_reading_is_tried() -> None:
    """Those of geometry and of poses; others are refused by rules of their own, or hold for every log."""
    geometry = {name for name, option in options_of(Ranges).items() if option.heading == GEOMETRY}
    assert geometry <= GIVEN.keys() | EFFECT
    assert {name for name, option in options_of(Ranges).items() if option.heading == POINT_CLOUDS} == {"slice", "bins"}


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
    ran = lidarcli(command, log, *own, *spelled(name), code=0)
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
