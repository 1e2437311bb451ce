"""The Python functions are called as the commands are, and tell of it: signatures, help, completion, wrong names."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import pytest

import lidarcli
from lidarcli.cli.declared import DeclaredOption
from tools.reference import commands

COMMANDS = (
    *("background", "clean", "detect", "diff", "export", "info", "map", "overlay"),
    *("plot", "poses", "report", "simulate", "track", "zones"),
)
FUNCTIONS = (*COMMANDS, "read", "tables")
READING = {*COMMANDS} - {"export", "plot", "report"}
"""Functions that tell how far they are."""
OF_THE_SHELL = {
    *("help", "help-all", "verbose", "quiet", "config", "format", "overwrite", "files-from", "base", "shard", "dry-run"),
    *("resume", "partition", "cluster", "brief", "stamps", "checks", "init"),
}
"""Options of how a command is run, checks, prints or writes; `export` has the stamps in Python, too."""
ONLY_SHELL = {
    "background": {"plot"},
    "detect": {"output", "beams"},
    "track": {"output", "beams"},
    "map": {"jobs"},
    "zones": {"output", "check"},
    "diff": {"check"},
    "info": {"output", "check"},
    "poses": {"check"},
    "plot": {"sweeps", "map", "animate", "fps", "start", "end", "only", "density"},
}
"""Options whose work Python has elsewhere, or not: `tables(beams=True)`, `map` for a map, a loop for several sweeps."""
OWN = {"log", "tables", "scene", "before", "after", "parameters", "axes", "overwrite", "progress"}
"""What stands in the place of the arguments of a command, and what only Python has."""


def options_of(command: str) -> dict[str, click.Option]:
    found = dict(commands())["background build" if command == "background" else command]
    return {
        max(option.opts, key=len).removeprefix("--"): option for option in found.params if isinstance(option, click.Option)
    }


@pytest.mark.parametrize("function", COMMANDS)
def test_names_and_defaults_are_those_of_the_command_line(function: str) -> None:
    options = options_of(function)
    parameters = inspect.signature(getattr(lidarcli, function)).parameters
    names = {name.replace("_", "-") for name in parameters.keys() - OWN}
    named = {
        name.removeprefix("no-") if isinstance(one, DeclaredOption) and one.declared.is_negated else name
        for name, one in options.items()
    } - (OF_THE_SHELL - {name for name in ("stamps",) if name in parameters})
    # The logs of a report are no argument of its command.
    names |= {"log"} if function == "report" else set()
    assert names == named - ONLY_SHELL.get(function, set())
    for name, option in options.items():
        if name.replace("-", "_") in parameters and isinstance(option.default, int | float | str):
            default = parameters[name.replace("-", "_")].default
            assert default == option.default or name == "output", name
            assert type(default) in (bool, int, float, str, tuple)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_keyword_is_in_the_signature_and_explained(name: str) -> None:
    function = getattr(lidarcli, name)
    words = inspect.getdoc(function)
    for parameter in inspect.signature(function).parameters.values():
        assert parameter.kind is not parameter.VAR_KEYWORD
        assert (parameter.kind is parameter.VAR_POSITIONAL) == (parameter.name == "after")
        assert re.search(rf"^{parameter.name} : \S", words, re.MULTILINE), parameter.name
    assert ("progress" in inspect.signature(function).parameters) == (name in {*READING, "tables"})
    assert "\nReturns\n-------\n" in words
    assert "\nRaises\n------\n" in words


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_wrong_name_is_told_with_the_nearest(name: str) -> None:
    """The internal class was named."""
    with pytest.raises(TypeError) as caught:
        getattr(lidarcli, name)("run.mcap", outptu=1, tpoic="/scan")
    assert str(caught.value) in (
        f"{name}() has no option 'outptu'; did you mean 'output'?",
        f"{name}() has no option 'outptu'; there are " + ", ".join(inspect.signature(getattr(lidarcli, name)).parameters),
    )
    if name != "report":
        with pytest.raises(TypeError, match=rf"^{name}\(\) has no option 'topcis'"):
            getattr(lidarcli, name)("run.mcap", topcis="/scan")


def test_the_public_names_are_there_and_typed() -> None:
    tree = ast.parse(Path(lidarcli.__file__).read_text(encoding="utf-8"))
    typed = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    told = {alias.name: node.module for node in typed.body for alias in node.names}
    assert told.pop("formalism") == "lidarcli"
    assert told == lidarcli._HOME
    assert {*told, "formalism", "__version__"} == {*lidarcli.__all__} == {*dir(lidarcli)}
    for name in lidarcli.__all__:
        assert getattr(lidarcli, name) is not None
    assert issubclass(lidarcli.UnreadableError, lidarcli.LidarcliError)
    assert lidarcli.Parameters(max_width=1.0) == lidarcli.formalism.Parameters(max_width=1.0)
    with pytest.raises(AttributeError, match=r"^module 'lidarcli' has no attribute 'nonsense'$"):
        _ = lidarcli.nonsense


def test_importing_the_package_imports_no_work() -> None:
    code = (
        "import sys, lidarcli; dir(lidarcli); "
        "print(sorted(m for m in sys.modules if m.startswith('lidarcli'))); "
        "lidarcli.detect; print([m for m in ('pandas', 'matplotlib', 'click', 'rich') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[1] == "[]"
    first = set(ast.literal_eval(done.stdout.splitlines()[0]))
    assert first <= {"lidarcli", "lidarcli._version", "lidarcli.system.compiled"}


def test_functions_stay_when_packages_of_like_names_are_imported() -> None:
    """`import lidarcli.poses.fit` made of a function a module that cannot be called."""
    code = (
        "import importlib, pkgutil, lidarcli; "
        "names = [each.name for each in pkgutil.iter_modules(lidarcli.__path__)]; "
        "[importlib.import_module(f'lidarcli.{name}') for name in names if name != '__main__']; "
        "from lidarcli.pose import fit; from lidarcli.simulation import run; "
        "print([name for name in lidarcli.__all__ if type(getattr(lidarcli, name)).__name__ == 'module'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "['formalism']\n"


def test_a_function_for_each_command() -> None:
    """Beside them only `read`, and `tables` for data frames."""
    functions = {name for name in lidarcli.__all__ if inspect.isfunction(getattr(lidarcli, name))}
    assert functions == {*FUNCTIONS, "read_catalogue"}
    assert {*COMMANDS} <= {name.removesuffix(" build") for name, _ in commands()}


@pytest.mark.parametrize(
    "call",
    [
        *(lambda: lidarcli.track(""), lambda: lidarcli.report([""]), lambda: lidarcli.info(log="")),
        *(lambda: lidarcli.report("t", baseline=""), lambda: lidarcli.diff("a.mcap", ""), lambda: lidarcli.clean("a", "")),
        *(lambda: lidarcli.track("a.mcap", columns=""), lambda: lidarcli.track(iter([""]))),
    ],
)
def test_an_empty_text_is_no_folder(call: Callable[[], object]) -> None:
    with pytest.raises(lidarcli.OptionError, match="an empty text names nothing"):
        call()
