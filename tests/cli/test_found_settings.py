"""A `lidarcli.toml` that lies in the working directory or above: whose it has to be, what it may set, and what is said."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from lidarcli.cli.settings import PassedOverError, refuse_owner
from tests.conftest import Ran

# Windows has neither.
grp = pytest.importorskip("grp")
pwd = pytest.importorskip("pwd")

Run = Callable[..., Ran]
NOBODY = 65534
OTHER = "it is on another machine, which would see who asks"
WAY_OUT = "(--config none ignores them)"


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory, which nobody else may write."""
    folder = tmp_path / "lab" / "today"
    folder.mkdir(parents=True)
    for each in (folder.parent, folder):
        each.chmod(0o755)
    monkeypatch.chdir(folder)
    return folder


def settings(folder: Path, text: str, mode: int = 0o644) -> Path:
    path = folder / "lidarcli.toml"
    path.write_text(text)
    path.chmod(mode)
    return path


def told(lidarcli: Run, *words: str) -> list[str]:
    """What a command says that does no work."""
    ran = lidarcli(*words, "config", "--format", "json")
    assert ran.code == 0, ran.err
    return ran.err.splitlines()


def jobs(lidarcli: Run, *words: str) -> str:
    """The value of `detect --jobs` in force."""
    ran = lidarcli(*words, "config", "detect")
    (line,) = [line for line in ran.out.splitlines() if line.split()[1] == "--jobs"]
    return line.split()[2]


def test_one_line_names_the_file_in_force(lidarcli: Run, lab: Path) -> None:
    file = settings(lab.parent, "[detect]\njobs = 2\n")
    assert told(lidarcli) == [f"settings from {file} {WAY_OUT}"]
    assert told(lidarcli, "-q") == []
    assert told(lidarcli, "--config", str(file)) == [f"settings from {file}"]
    assert told(lidarcli, "--config", "none") == []
    assert (jobs(lidarcli), jobs(lidarcli, "--config", "none")) == ("2", "automatic")


def test_a_found_file_cannot_ask_for_silence(lidarcli: Run, lab: Path, logs: Path) -> None:
    file = settings(lab, "quiet = true\n")
    assert lidarcli("detect", logs / "run.mcap").err == f"settings from {file} {WAY_OUT}\n"
    assert lidarcli("-q", "info", logs / "run.mcap").err == ""


@pytest.mark.parametrize("words", [("--help",), ("--version",), ("detect", "--help"), ("completion", "bash")])
def test_help_and_completion_say_nothing_of_settings(
    lidarcli: Run, lab: Path, words: tuple[str, ...]
) -> None:
    settings(lab, "cluster = 'tcp://h:1'\n")
    ran = lidarcli(*words)
    assert (ran.code, ran.err) == (0, "")


@pytest.mark.parametrize(
    ("text", "key", "cause"),
    [
        ('[detect]\ncluster = "tcp://127.0.0.1:9787"\n', "cluster", "whoever answers there runs the work"),
        ('cluster = "local:2"\n', "cluster", "whoever answers there runs the work"),
        ("[report]\noverwrite = true\n", "overwrite", "files would be replaced"),
        ("[detect]\nresume = true\n", "resume", "it decides which logs are skipped"),
        ('[info]\nfiles_from = "list"\n', "files-from", "a list names files and URLs anywhere"),
        ('[report]\noutput = "/home/me/.bashrc"\n', "output", "/home/me/.bashrc is outside {lab}"),
        ('[report]\noutput = ["a.md", "../b.md"]\n', "output", "../b.md is outside {lab}"),
        ('[detect]\noutput = "a/../../b"\n', "output", "a/../../b is outside {lab}"),
        ('[track]\noutput = "~/tables"\n', "output", "~/tables is outside {lab}"),
        ('[track]\noutput = "C:\\\\tables"\n', "output", "C:\\tables is outside {lab}"),
        ('[track]\noutput = "s3://robots/tables"\n', "output", "s3://robots/tables is outside {lab}"),
        ('[detect]\noutput = "link/t"\n', "output", "link/t is outside {lab}"),
        ('[detect]\noutput = "round"\n', "output", "round is outside {lab}"),
        ('[detect]\noutput = "a\\u0000b"\n', "output", "a\\x00b is outside {lab}"),
        ('[background.build]\nplot = "/tmp/x.png"\n', "plot", "/tmp/x.png is outside {lab}"),
        ('[simulate]\nmap = "../x.yaml"\n', "map", "../x.yaml is outside {lab}"),
        ('[detect]\nbackground = "s3://b/x?endpoint_override=h"\n', "background", OTHER),
        ('[report]\nlog = ["a.mcap", "//host/b"]\n', "log", OTHER),
        ('[detect]\nbase = "S3://b/x"\n', "base", OTHER),
        ('poses = "/etc/passwd"\n', "poses", "/etc/passwd is outside {lab}"),
        ('[detect]\nposes = "../p.tum"\n', "poses", "../p.tum is outside {lab}"),
        ('[track]\ncatalogue = "link/c.toml"\n', "catalogue", "link/c.toml is outside {lab}"),
        ('[report]\nlog = "li[n]k"\n', "log", "li[n]k is outside {lab}"),
        ('[report]\nbaseline = ["/home"]\n', "baseline", "/home is outside {lab}"),
        ('[track]\nposes = "pipe"\n', "poses", "pipe is no regular file"),
        ('[detect]\nbackground = "pipe"\n', "background", "pipe is no regular file"),
        ('[track]\ncatalogue = "pipe"\n', "catalogue", "pipe is no regular file"),
    ],
)
def test_what_a_found_file_cannot_set(lidarcli: Run, lab: Path, text: str, key: str, cause: str) -> None:
    file = settings(lab, text)
    (lab / "link").symlink_to(lab.parent.parent)
    (lab / "round").symlink_to("round")
    os.mkfifo(lab / "pipe")
    there = sorted(path.name for path in lab.iterdir())
    section = text.split("]")[0].removeprefix("[") if text.startswith("[") else ""
    place = f"[{section}]: '{key}'" if section else f"'{key}'"
    command = (section or "detect").split(".")
    cause = cause.format(lab=lab)
    ran = lidarcli(
        *command, "run.mcap", *(() if key == "output" else ("-o", "new")) if command != ["info"] else ()
    )
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == (
        f"lidarcli: {file}: {place} is not taken from a file that was not named ({cause}): use it with --config {file}, "
        f"write --{key} on the command line, or use no file with --config none\n"
    )
    assert sorted(path.name for path in lab.iterdir()) == there
    # Commands that have no use for it go on, and the settings in force tell of it.
    if section != "info" and text != 'poses = "/etc/passwd"\n':
        assert lidarcli("info", "none.mcap").code == 3
    shown = [line for line in lidarcli("config").out.splitlines() if f"--{key}" in line]
    assert shown
    assert all(line.endswith(f"  {file}, refused: {cause}") for line in shown)
    rows = [row for row in json.loads(lidarcli("config", "--format", "json").out) if row["option"] == key]
    assert {(row["origin"], row["refused"]) for row in rows} == {(str(file), cause.replace("\\x00", "\0"))}
    assert lidarcli(*command, "--help").code == 0
    # Named, it is obeyed; also after the command, and another file in its place.
    assert told(lidarcli, "--config", str(file)) == [f"settings from {file}"]
    assert all(
        row["refused"] is None
        for row in json.loads(lidarcli("--config", file, "config", "--format", "json").out)
    )
    (lab / "mine.toml").touch()
    for named in ("mine.toml", "none"):
        assert "lidarcli.toml" not in lidarcli("config", "--config", named).err


def test_the_command_line_takes_the_place_of_a_refused_value(lidarcli: Run, lab: Path, logs: Path) -> None:
    settings(lab, '[detect]\noutput = "/data/x"\noverwrite = true\nposes = "/etc/passwd"\n')
    (lab / "p.tum").write_text("0 0 0 0 0 0 0 1\n")
    words = ("detect", logs / "run.mcap", "-o", "mine", "--poses", "p.tum", "--overwrite")
    ran = lidarcli(*words)
    assert "is not taken" not in ran.err
    assert lidarcli(*words[:-1]).code == 2


def test_inputs_below_the_folder_are_fine(lidarcli: Run, lab: Path, logs: Path) -> None:
    data = lab.parent / "data"
    data.mkdir()
    (data / "run.mcap").write_bytes((logs / "run.mcap").read_bytes())
    (lab.parent / "link").symlink_to(data)
    for log in ("data/run.mcap", "link/*.mcap", "data", f"{data}/run.mcap"):
        settings(lab.parent, f'[report]\nlog = "{log}"\n')
        rows = json.loads(lidarcli("config", "report", "--format", "json").out)
        (row,) = (row for row in rows if row["option"] == "log")
        assert (row["refused"], row["value"]) == (None, str(lab.parent / log))


def test_outputs_in_the_folder_are_fine(lidarcli: Run, lab: Path, logs: Path) -> None:
    settings(lab.parent, '[detect]\noutput = "link/tables"\n[report]\noutput = ["-"]\n')
    (lab / "link").symlink_to(lab.parent)
    assert lidarcli("detect", logs / "run.mcap").code == 0
    assert (lab.parent / "tables" / "run.objects.parquet").exists()
    assert lidarcli("report", lab.parent / "tables").code == 0


@pytest.mark.parametrize(
    ("file", "folder", "cause"),
    [
        (0o646, 0o755, "everybody may write it"),
        (0o644, 0o777, "everybody may write the folder {lab}"),
        (0o644, 0o1777, None),
        (0o600, 0o700, None),
    ],
)
def test_a_file_that_others_could_have_written_is_passed_over(
    lidarcli: Run, lab: Path, file: int, folder: int, cause: str | None
) -> None:
    path = settings(lab, '[detect]\njobs = 2\ncluster = "local:1"\n' if cause else "jobs = 2\n", file)
    lab.chmod(folder)
    expected = (
        f"settings from {path} {WAY_OUT}"
        if cause is None
        else f"lidarcli: {path} is not used, defaults are: {cause.format(lab=lab)}; --config {path} uses it"
    )
    assert told(lidarcli) == [expected]
    assert jobs(lidarcli) == ("2" if cause is None else "automatic")
    # It is told always, as the command does something else than the file says.
    assert told(lidarcli, "-q") == ([] if cause is None else [expected])


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, int, list[str]], None]:
    """Let the user be `me`, with a primary group of its own, and files be of a group."""
    gid = os.getegid()

    def make(name: str, primary: int, members: list[str]) -> None:
        monkeypatch.setattr(pwd, "getpwuid", lambda uid: SimpleNamespace(pw_name="me", pw_gid=primary))
        monkeypatch.setattr(grp, "getgrgid", lambda gid: SimpleNamespace(gr_name=name, gr_mem=members))

    make("me", gid, [])
    return make


def test_the_group_of_the_user_alone_may_write(
    lab: Path, groups: Callable[[str, int, list[str]], None]
) -> None:
    """An ordinary checkout with umask 002."""
    file = settings(lab, "jobs = 2\n", 0o664)
    lab.chmod(0o775)
    gid = file.stat().st_gid
    for members in ([], ["me"]):
        groups("me", gid, members)
        refuse_owner(file)
    for name, primary, members in (("me", gid, ["you"]), ("staff", gid, []), ("me", gid + 1, [])):
        groups(name, primary, members)
        with pytest.raises(PassedOverError, match="a group of users may write it"):
            refuse_owner(file)


def test_a_file_or_a_link_of_somebody_else_does_not_count(
    lab: Path, lidarcli: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = settings(lab, "jobs = 2\n")
    found = os.stat_result([0o100644, 1, 1, 1, NOBODY, NOBODY, 9, 0, 0, 0])
    with pytest.raises(PassedOverError, match="it belongs to "):
        refuse_owner(file, found)
    if os.geteuid() != 0:
        # Whose files these are: everything then belongs to somebody else.
        monkeypatch.setattr(os, "geteuid", lambda: NOBODY)
        assert " is not used, defaults are: it belongs to " in told(lidarcli)[0]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("what", ["it", "the link", "the folder"])
def test_what_belongs_to_somebody_else_is_passed_over(lab: Path, lidarcli: Run, what: str) -> None:
    mine = settings(lab.parent, "jobs = 2\n")
    file = lab / "lidarcli.toml"
    if what == "the link":
        file.symlink_to(mine)
        os.lchown(file, NOBODY, NOBODY)
    elif what == "it":
        os.chown(settings(lab, "jobs = 2\n", 0o600), NOBODY, NOBODY)
    else:
        settings(lab, "jobs = 2\n")
        os.chown(lab, NOBODY, NOBODY)
    (line,) = told(lidarcli)
    assert line.startswith(f"lidarcli: {file} is not used, defaults are: {what}")
    assert f" belongs to {pwd.getpwuid(NOBODY).pw_name}; --config {file} uses it" in line
    assert jobs(lidarcli) == "automatic"
    assert jobs(lidarcli, "--config", str(file)) == "2"


def test_where_files_have_no_such_owner_the_folder_of_the_user_counts(
    lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = settings(lab, "jobs = 2\n", 0o666)
    monkeypatch.delattr(os, "geteuid")
    monkeypatch.setattr(Path, "home", lambda: lab.parent)
    refuse_owner(file)
    monkeypatch.setattr(Path, "home", lambda: lab / "elsewhere")
    with pytest.raises(PassedOverError, match="it is not below "):
        refuse_owner(file)
