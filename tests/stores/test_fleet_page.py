"""docs/fleet.md does what it says: its commands in a store, its recipes with what an orchestrator sets."""

from __future__ import annotations

import ast
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import duckdb
import pytest
from ruamel.yaml import YAML

from tests.places import ROOT, SAMPLES
from tests.stores.conftest import Store
from tools import examples

PAGE = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
LOGS = {"2026-11-21/room.mcap": "room.mcap", "2026-11-21/corridor.bag": "corridor.bag", "2026-11-22/room.mcap": "room.mcap"}
TABLES = [f"tables/{log.partition('.')[0]}.{table}.parquet" for log in sorted(LOGS) for table in ("objects", "sweeps")]


@pytest.fixture
def folder(store: Store, tmp_path: Path) -> Path:
    """Where the examples run; the logs of the page are in the store."""
    for name, sample in LOGS.items():
        store.put(f"logs/{name}", (SAMPLES / sample).read_bytes())
    return tmp_path


def file(name: str) -> str:
    """A file of the page."""
    (found,) = re.findall(rf"^```\w+ {re.escape(name)}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return str(found)


def shell(command: list[str], folder: Path, **variables: str) -> None:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    ran = subprocess.run(
        command, cwd=folder, env={**os.environ, "PATH": path, **variables}, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr


def written(store: Store) -> list[str]:
    return store.keys("tables")


@pytest.mark.whole
def test_the_commands_and_the_query_of_the_page(folder: Path) -> None:
    done = list(examples.run(PAGE, folder))
    assert len(done) >= 9
    for example in done:
        assert example.holds, f"$ {example.example.command}\n{example.got}\nexit code {example.code}"
    (query,) = re.findall(r"^```sql\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    with duckdb.connect() as connection:
        connection.execute(f"SET file_search_path = '{folder}'")
        ((_, objects, logs),) = connection.execute(query).fetchall()
    assert objects > 500
    assert logs == 3


@pytest.mark.whole
def test_the_array_of_slurm(folder: Path, store: Store) -> None:
    script = folder / "lidarcli.sbatch"
    script.write_text(file("lidarcli.sbatch"))
    for task in range(1, 4):
        variables = {"SLURM_ARRAY_TASK_ID": str(task), "SLURM_ARRAY_TASK_COUNT": "3", "SLURM_CPUS_PER_TASK": "1"}
        shell(["bash", str(script)], folder, **variables)
    assert written(store) == sorted(TABLES)


@pytest.mark.whole
def test_the_job_of_kubernetes(folder: Path, store: Store) -> None:
    job: Any = YAML(typ="safe").load(file("job.yaml"))
    container = job["spec"]["template"]["spec"]["containers"][0]
    for index in range(job["spec"]["completions"]):
        shell([*container["command"], *container["args"]], folder, JOB_COMPLETION_INDEX=str(index))
    assert written(store) == sorted(TABLES)


@pytest.mark.whole
def test_the_rule_of_snakemake(folder: Path) -> None:
    (command,) = re.findall(r'shell: "([^"]+)"', file("Snakefile"))
    outputs = re.findall(r'"(tables/[^"]+)"', file("Snakefile").partition("rule detect")[2])
    (folder / "logs" / "trip").mkdir(parents=True)
    (folder / "logs" / "trip" / "room.mcap").write_bytes((SAMPLES / "room.mcap").read_bytes())
    shell(["bash", "-c", command.replace("{input}", "logs/trip/room.mcap")], folder)
    assert all((folder / output.replace("{log}", "trip/room")).exists() for output in outputs)


@pytest.mark.whole
def test_the_task_of_airflow(folder: Path, store: Store) -> None:
    tree = ast.parse(file("dag.py"))
    (command,) = [
        keyword.value.value
        for node in ast.walk(tree)
        if isinstance(node, ast.keyword) and (keyword := node).arg == "bash_command"
        if isinstance(keyword.value, ast.Constant)
    ]
    assert shlex.split(str(command))[0] == "lidarcli"
    shell(["bash", "-c", str(command)], folder)
    assert written(store) == sorted(TABLES)
