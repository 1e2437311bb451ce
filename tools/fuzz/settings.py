"""Files `lidarcli.toml` with any keys and values: in the working directory, where they do nothing, and named."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import chdir

from tools.fuzz.commands import judge_commands
from tools.fuzz.place import Place
from tools.fuzz.tables import LOG, put
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words

NAME = "lidarcli.toml"
TABLES = ("", "detect", "report", "track", "plot", "info", "background", "background.build", "simulate", "odd")
KEYS = (
    *("output", "overwrite", "cluster", "files-from", "resume", "base", "partition", "catalogue", "background"),
    *("plot", "map", "log", "baseline", "poses", "jobs", "max_width", "range", "quiet", "verbose", "config", "x"),
)
VALUES = (
    *('"../victims/thesis"', '"../victims/new"', '["../victims/thesis", "a.md"]', '"a/../../victims/new"'),
    *('"~/x"', '"C:\\\\x"', '"-"', '"tables"', '"a.txt"', '""', '"\\u0000"'),
    *('"s3://b/x"', '"tcp://127.0.0.1:1"', '"//host/x"', '"local:1"', '"none"'),
    *("true", "false", "1", "-1", "1e400", "nan", "[]", "[0.1, 20]", "{}", "1979-05-27", '["\\u001b"]'),
)
KNOWN = (
    '[report]\noutput = "../victims/thesis"\nformat = "text"\noverwrite = true\n',
    '[report]\noutput = ["a.md", "../victims/new.md"]\n',
    '[detect]\noutput = "../victims/folder"\n',
    '[detect]\ncluster = "tcp://127.0.0.1:1"\n',
    '[detect]\nbackground = "s3://b/x"\n',
    'output = "../victims/new"\n',
    "quiet = true\njobs = 1\n",
)
COMMANDS: tuple[list[str], ...] = (
    ["report", "../in/run.objects.parquet"],
    ["-q", "detect", f"../in/{LOG}"],
    ["config"],
    ["--config", NAME, "config", "--format", "json"],
    ["--config", NAME, "config", "report"],
    ["--config", "none", "config", "detect"],
)


def write(place: Place, number: int, random: Random) -> None:
    """A file in the folder of outputs, where the commands are run."""
    put(place)
    text = KNOWN[number] if number < len(KNOWN) else _settings(random)
    (place.out / NAME).write_text(text, encoding="utf-8", errors="surrogateescape")
    place.note(commands=[*COMMANDS])


def judge(place: Place) -> Iterator[str]:
    """Beside the file."""
    with chdir(place.out):
        yield from judge_commands(place)


def _settings(random: Random) -> str:
    lines = []
    for table in random.permutation(len(TABLES))[: int(random.integers(1, 4))]:
        lines += [f"[{TABLES[table]}]"] if table else []
        for _ in range(int(random.integers(1, 4))):
            key, value = (pool[int(random.integers(len(pool)))] for pool in (KEYS, VALUES))
            lines.append(f"{key} = {value}")
    text = "\n".join([*lines, ""])
    return text if random.integers(4) else mutate_words(text, random)


def settings_targets() -> list[Target]:
    """Settings, named or not."""
    return [Target("settings", write, judge, weight=20, known=len(KNOWN))]
