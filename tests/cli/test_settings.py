"""Settings from a named file and from the environment: which one counts, and clear words for what is wrong with them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Run = Callable[..., Any]
Settings = Callable[[str], Path]


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory of its own, with nothing set in the environment."""
    folder = tmp_path / "lab" / "today"
    folder.mkdir(parents=True)
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def settings(lab: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """Write a settings file above the working directory, and let the environment name it."""

    def write(text: str) -> Path:
        file = lab.parent / "lidarcli.toml"
        file.write_text(text, encoding="utf-8")
        monkeypatch.setenv("LIDARCLI_CONFIG", str(file))
        return file

    return write


def origins(lidarcli: Run, *words: str) -> dict[str, tuple[str | None, str]]:
    ran = lidarcli("config", *words, "--format", "json")
    assert ran.code == 0, ran.err
    return {f"{row['command']} {row['option']}": (row["value"], row["origin"]) for row in json.loads(ran.out)}


def test_flag_before_environment_before_file_before_default(
    lidarcli: Run, lab: Path, settings: Settings, logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def parameters(*arguments: str) -> str:
        ran = lidarcli("-v", "detect", str(logs / "run.mcap"), "-o", "out", "--overwrite", *arguments)
        assert ran.code == 0, ran.err
        return str(next(line for line in ran.err.splitlines() if line.startswith("1 log;")))

    assert "min_beams=3, max_width=2.0," in parameters()
    settings("[detect]\nmin-beams = 4\nmax-width = 1.5\n")
    assert "min_beams=4, max_width=1.5," in parameters()
    monkeypatch.setenv("LIDARCLI_DETECT_MIN_BEAMS", "5")
    assert "min_beams=5, max_width=1.5," in parameters()
    assert "min_beams=6, max_width=1.5," in parameters("--min-beams", "6")


def test_a_file_counts_only_where_it_is_named(lidarcli: Run, lab: Path) -> None:
    """One in the working directory is told of, and one above it is not looked for."""
    above, here = lab.parent / "lidarcli.toml", lab / "lidarcli.toml"
    above.write_text("[detect]\njobs = 2\n")
    assert origins(lidarcli) == {}
    assert "lidarcli.toml" not in lidarcli("config").err
    here.write_text("[track]\njobs = 3\n")
    assert origins(lidarcli) == {}
    note = "lidarcli.toml here is not used: name it with --config lidarcli.toml\n"
    assert lidarcli("config", "--format", "json").err == note
    for words in (("-q",), ("--config", "none")):
        assert lidarcli(*words, "config", "--format", "json").err == ""
    for words in (("--help",), ("detect", "--help"), ("completion", "bash")):
        assert lidarcli(*words).err == ""
    for file, option in ((above, "detect jobs"), (here, "track jobs")):
        value = "2" if file == above else "3"
        assert origins(lidarcli, "--config", str(file)) == {option: (value, str(file))}
        before = lidarcli("--config", file, "config", "--format", "json")
        assert [row["origin"] for row in json.loads(before.out)] == [str(file)]
        assert before.err == f"settings from {file}\n"


def test_what_stands_before_the_tables_is_for_every_command_that_has_it(
    lidarcli: Run, lab: Path, settings: Settings
) -> None:
    settings(
        'range = [0.1, 20]\nno_return = ["inf", 81.91]\nverbose = false\n'
        '[background.build]\nrange = [0.2, 30]\nplot = "scene.png"\n[detect]\ntopic = "/front"\n'
    )
    found = {name: value for name, (value, _) in origins(lidarcli).items()}
    assert found["detect range"] == found["track range"] == found["map range"] == "0.1 20"
    assert found["background build range"] == "0.2 30"
    assert found["background subtract range"] == "0.1 20"
    assert found["detect no-return"] == "inf,81.91"
    assert found["detect topic"] == "/front"
    assert "report range" not in found


def test_paths_of_inputs_are_meant_from_the_folder_of_the_file(
    lidarcli: Run, lab: Path, settings: Settings, logs: Path
) -> None:
    settings('[detect]\ncatalogue = "things.toml"\noutput = "tables"\n')
    ran = lidarcli("detect", str(logs / "run.mcap"), code=3)
    assert f"\nlidarcli: {lab.parent / 'things.toml'}: cannot read the catalogue" in ran.err
    (lab.parent / "things.toml").write_text('[[thing]]\nname = "box"\nlength = 1.0\nwidth = 1.0\n')
    assert lidarcli("detect", str(logs / "run.mcap")).code == 0
    assert (lab / "tables" / "run.objects.parquet").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[detect]\nmax-widht = 1\n", "[detect]: no option 'max-widht'; did you mean 'max-width'?"),
        ("jbos = 1\n", "no option 'jbos'; did you mean 'jobs'?"),
        ("[detekt]\njobs = 1\n", "[detekt]: no such command; did you mean [detect]?"),
        ("[background]\nstation-distance = 0.5\n", "[background.station-distance]: no such command"),
        ("[background.build]\njobs = 1\n", "[background.build]: no option 'jobs'"),
        ("[background.subtract]\njbos = 1\n", "[background.subtract]: no option 'jbos'; did you mean 'jobs'?"),
        ("[background.build.x]\n", "[background.build]: no option 'x'"),
        ("[detect.x]\n", "[detect]: no option 'x'"),
        ("detect = 3\n", "no option 'detect'"),
        ("[background.biuld]\n", "[background.biuld]: no such command; did you mean [background.build]?"),
        ("[detect]\nbeams = 1\n", "[detect]: 'beams' must be true or false"),
        ("[detect]\njobs = [1, 2]\n", "[detect]: 'jobs' takes one value, not a list"),
        ("[detect]\njobs = true\n", "[detect]: 'jobs' must be a text, a number or a list of them"),
        ("[detect]\nconfig = 'x'\n", "[detect]: no option 'config'"),
        ("jobs 2\n", "not valid TOML"),
        ("format = 'json'\n", "'format' is not the same in every command: set it below [detect] or another one"),
    ],
)
def test_whatever_is_wrong_with_a_file_is_one_line(
    lidarcli: Run, lab: Path, settings: Settings, text: str, words: str
) -> None:
    settings(text)
    # Also where another command is meant: a wrong file is never in force in part.
    ran = lidarcli("info", "run.mcap")
    assert ran.code == (3 if words == "not valid TOML" else 2)
    (line,) = ran.err.splitlines()
    assert line.startswith(f"lidarcli: {lab.parent / 'lidarcli.toml'}: {words}")


def test_a_wrong_value_says_where_it_comes_from(
    lidarcli: Run, lab: Path, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings("[detect]\nmin-beams = 0\n")
    ran = lidarcli("detect", "run.mcap", code=2)
    assert f"(set in {lab.parent / 'lidarcli.toml'})." in ran.err
    monkeypatch.setenv("LIDARCLI_DETECT_MIN_BEAMS", "many")
    ran = lidarcli("detect", "run.mcap", code=2)
    assert "Invalid value for '--min-beams': 'many'" in ran.err
    assert "(set in LIDARCLI_DETECT_MIN_BEAMS)." in ran.err


def test_variables_that_do_nothing_are_told(lidarcli: Run, lab: Path, logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIDARCLI_DETECT_TOPICS", "/scan")
    monkeypatch.setenv("LIDARCLI_DETCT_JOBS", "2")
    monkeypatch.setenv("LIDARCLI_HELP", "1")
    ran = lidarcli("detect", str(logs / "run.mcap"), code=0)
    hint = "did you mean LIDARCLI_DETECT_TOPIC?"
    assert ran.err.splitlines()[0] == f"lidarcli: LIDARCLI_DETECT_TOPICS: detect has no such option; {hint}"


def test_config_of_a_command_shows_every_option_of_it(lidarcli: Run, lab: Path) -> None:
    ran = lidarcli("config", "detect")
    lines = {line.split()[1]: line for line in ran.out.splitlines()}
    assert {"--jobs", "--range", "--memory", "--overwrite"} <= lines.keys()
    assert all(line.endswith("default") for line in lines.values())
    assert "robust" in lines["--profile"]
    assert "0.3" in lines["--min-thing"]
    assert "required" in lidarcli("config", "background").out
    assert lidarcli("config", "nothing").code == 2
    assert lidarcli("config", "background", "nothing").code == 2
    commands = {line.split("  ")[0] for line in lidarcli("config", "background").out.splitlines()}
    assert commands == {"background build", "background subtract"}
    assert lidarcli("config").err.splitlines()[0].startswith("settings file: none")


@pytest.mark.parametrize("before", [True, False])
def test_verbose_and_quiet_are_taken_before_and_after_the_command(
    lidarcli: Run, lab: Path, logs: Path, before: bool
) -> None:
    def run(flag: str) -> Any:
        call = ["detect", str(logs / "run.mcap"), "-o", "out", "--overwrite"]
        return lidarcli(*([flag, *call] if before else [*call, flag]))

    assert run("-q").err == ""
    assert run("-v").err.startswith("1 log; profile=robust")
    assert lidarcli("-q", "background", "-v", "build", "x", "-o", "y").code == 2
    assert "exclude each other" in lidarcli("background", "-q", "build", "-v", "x", "-o", "y").err
    assert "exclude each other" in lidarcli("-q", "info", "-v", "x").err


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_named_file_is_for_a_nested_command_wherever_it_is_named(
    lidarcli: Run, lab: Path, logs: Path, place: int
) -> None:
    (lab / "robot.toml").write_text("[background.build]\nevery = 5\n")
    words: list[Any] = ["background", "build", logs / "run.mcap", "-o", "b.parquet"]
    words[place:place] = ["--config", "robot.toml"]
    ran = lidarcli(*words, code=0)
    assert "4 sweeps" in ran.err


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("table", "arguments", "wrote"),
    [
        ("sweep = 3", ("--sweeps", "0,1"), ["run-0.png", "run-1.png"]),
        ("sweep = 3", ("--at", "0.2"), ["run-2.png"]),
        ("at = 0.3", ("--sweep", "0"), ["run-0.png"]),
        ('sweeps = "1,2"', ("--sweep", "0"), ["run-0.png"]),
        ("sweep = 3", (), ["run-3.png"]),
    ],
)
def test_the_command_line_goes_before_what_excludes_it(
    lidarcli: Run, lab: Path, settings: Settings, logs: Path, table: str, arguments: tuple[str, ...], wrote: list[str]
) -> None:
    settings(f"[plot]\nview = 'sweep'\ndpi = 30\n{table}\n")
    ran = lidarcli("plot", str(logs / "run.mcap"), *arguments)
    assert ran.code == 0, ran.err
    assert sorted(path.name for path in lab.glob("*.png")) == wrote


def test_loudness_that_is_typed_goes_before_that_of_a_setting(
    lidarcli: Run, lab: Path, settings: Settings, logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = ("detect", str(logs / "run.mcap"), "-o", "out", "--overwrite")
    monkeypatch.setenv("LIDARCLI_QUIET", "1")
    assert lidarcli(*call).err == ""
    assert lidarcli(*call, "-v").err.startswith("1 log; profile=robust")
    monkeypatch.delenv("LIDARCLI_QUIET")
    settings("verbose = true\n")
    assert "1 log; profile=robust" in lidarcli(*call).err
    assert lidarcli("-q", *call).err == ""
