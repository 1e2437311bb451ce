"""Help: complete, readable at 80 columns, and light."""

from __future__ import annotations

import platform
import re
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
from lidarcli.cli.declared import DeclaredOption
from lidarcli.cli.main import COMMANDS, cli
from lidarcli.formalism import Parameters
from lidarcli.options.forms import options_of
from lidarcli.options.groups import Learning, Mapping, Plotting, Reporting
from lidarcli.options.objects import Tabling
from lidarcli.options.reading import Reading
from lidarcli.sweeps.range_rules import RangeRules, parse_no_return
from lidarcli.system.compiled import about_core
from tests.places import SAMPLES
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
    ran = lidarcli(name, "--help")
    assert ran.code == 0
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


HEAVY = ("numpy", "pandas", "pyarrow", "mcap", "rosbags", "rich")
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
    ran = lidarcli("detect", "run.mcap", "--range-unti", "mm")
    assert ran.code == 2
    assert "--range-unit" in ran.err


def test_an_option_has_the_same_words_everywhere() -> None:
    """What a command fills with something else is named here."""
    of_its_own = {"output", "format", "topic", "background", "tracks", "objects", "layout", "map", "sweeps", "only"}
    of_its_own |= {"brief", "columns", "station_distance", "station_angle", "view", "dpi", "check", "zones", "clips"}
    of_its_own |= {"only"}
    words: dict[str, set[str]] = {}
    for _, command in commands():
        for parameter in command.params:
            if isinstance(parameter, DeclaredOption) and parameter.field not in of_its_own:
                words.setdefault(parameter.field, set()).add(parameter.declared.help)
    assert {field for field, said in words.items() if len(said) > 1} == set()
    keywords = {
        field: option.help
        for group in (Reading, Tabling, Learning, Mapping, Plotting, Reporting)
        for field, option in options_of(group).items()
        if field not in of_its_own
    }
    # The table of beams that `tables` makes is the one that `detect --beams` writes.
    assert {field: {said} for field, said in keywords.items()} == {field: words[field] for field in keywords}
