"""`make bounds`: the compiled kernels with bounds checked, in a copy of the tree, on random batches and logs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
COPY = ROOT / "build" / "bounds"
NEEDED = ("lidarcli", "tests", "tools", "benchmarks", "samples", "docs")
FILES = ("pyproject.toml", "setup.py", "README.md", "LICENSE")
REAL_LOGS = "LIDARCLI_REAL_LOGS"
CHECKED = b"Out of bounds on buffer access"
"""What a kernel with bounds checked can say."""
WILD = "import numpy as np; from lidarcli.kernels.ragged import span_sum; span_sum(np.zeros(2), np.array([7, 8]))"
"""A span that begins beyond the values."""
READ = (0, 3, 4)
"""Exit codes of `detect` for real logs: some are damaged, some have no LaserScan."""
SIGNS = ("IndexError", "Exception ignored")
"""What a wild index says where nobody raises it, too."""
RUNS = (["--walls", "--beams"], ["--profile", "paper"], ["--threshold", "0.2", "--group-gap", "0.3"])


def main() -> None:
    """Copy, build, make sure that bounds are checked, run."""
    tree = COPY / "tree"
    copy_tree(tree)
    build(tree, COPY / "tools")
    if unchecked := [path.name for path in kernels(tree) if CHECKED not in path.read_bytes()]:
        sys.exit(f"built without bounds checked: {', '.join(unchecked)}")
    if "IndexError" not in python(tree, "-c", WILD).stderr:
        sys.exit("a wild index is not noticed")
    print(f"{len(kernels(tree))} kernels with bounds checked", flush=True)
    tests = python(tree, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/kernels", shown=True)
    if tests.returncode:
        sys.exit("tests/kernels fails")
    logs = [tree / "samples", *([Path(os.environ[REAL_LOGS])] if os.environ.get(REAL_LOGS) else [])]
    problems = [problem for folder in logs for options in RUNS for problem in detected(tree, folder, options)]
    if problems:
        sys.exit("\n".join(problems))


def copy_tree(tree: Path) -> None:
    """The sources alone: no kernel that was built before."""
    shutil.rmtree(tree.parent, ignore_errors=True)
    tree.mkdir(parents=True)
    for name in NEEDED:
        shutil.copytree(
            ROOT / name, tree / name, ignore=shutil.ignore_patterns("*.so", "*.pyd", "__pycache__")
        )
    for name in FILES:
        shutil.copyfile(ROOT / name, tree / name)


def build(tree: Path, tools: Path) -> None:
    """Compile in the copy, with what the project needs for building in a folder of its own."""
    needs = tomllib.loads((tree / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
    subprocess.run([*pip, "--target", str(tools), *needs], check=True)
    environment = {**os.environ, "LIDARCLI_BOUNDS": "1", "PYTHONPATH": str(tools)}
    print("building, which takes minutes ...", flush=True)
    command = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if done.returncode or len(kernels(tree)) != len(list((tree / "lidarcli" / "kernels").glob("*.pyx"))):
        sys.exit(f"cannot build:\n{done.stdout}{done.stderr}")


def kernels(tree: Path) -> list[Path]:
    """What was built."""
    return sorted(
        path for suffix in ("so", "pyd") for path in (tree / "lidarcli" / "kernels").glob(f"*.{suffix}")
    )


def python(tree: Path, *arguments: str, shown: bool = False) -> subprocess.CompletedProcess[str]:
    """Run Python in the copy, on the code of the copy."""
    environment = {name: value for name, value in os.environ.items() if name != "LIDARCLI_COMPILED"}
    environment["PYTHONPATH"] = str(tree)
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, cwd=tree, env=environment, capture_output=not shown, text=True, check=False
    )


def detected(tree: Path, folder: Path, options: list[str]) -> list[str]:
    """What is wrong when all logs of a folder go through `detect`."""
    with tempfile.TemporaryDirectory() as out:
        ran = python(tree, "-m", "lidarcli", "-q", "detect", str(folder), "-o", out, *options)
        tables = sum(1 for _ in Path(out).rglob("*.objects.parquet"))
    print(f"detect {folder} {' '.join(options)}: {tables} logs, exit {ran.returncode}", flush=True)
    wrong = ran.returncode not in READ or not tables or any(sign in ran.stderr for sign in SIGNS)
    return [f"detect {folder} {' '.join(options)}: exit {ran.returncode}\n{ran.stderr}"] if wrong else []


if __name__ == "__main__":
    main()
