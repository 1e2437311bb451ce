"""Does an installed lidarcli work? Its version, that its core is compiled, and the golden tables of the samples.

`python -P tools/smoke.py`, with the Python that it is installed for; the sources around this file give the samples and
what is expected, the code that runs is the installed one.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
import tempfile
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Exit with a line on what does not work."""
    # Last, so that the package of this tree does not take the place of the installed one.
    sys.path.append(str(ROOT))
    import lidarcli

    package = Path(lidarcli.__file__).parent
    if package.is_relative_to(ROOT / "lidarcli"):
        sys.exit(f"no lidarcli is installed: {package} is the source tree")
    scripts = sysconfig.get_path("scripts")
    # Its name has a suffix on Windows.
    command = shutil.which("lidarcli", path=scripts)
    if command is None:
        sys.exit(f"{scripts}: no command lidarcli")
    said = subprocess.run([command, "--version"], capture_output=True, text=True, check=False)
    if said.stdout.splitlines()[:1] != [f"lidarcli {version('lidarcli')}"]:
        sys.exit(f"{command} --version: {said.stdout}{said.stderr}")
    built = sorted(path for path in package.rglob("*") if path.name.endswith(tuple(EXTENSION_SUFFIXES)))
    for path in built:
        import_module(".".join(path.relative_to(package.parent).with_name(path.name.split(".")[0]).parts))
    if not built:
        sys.exit(f"{package}: nothing in it is compiled for this Python")
    wrong = golden_tables()
    if wrong:
        sys.exit("\n".join(wrong))
    print(f"{said.stdout.splitlines()[0]} in {package}: {len(built)} compiled modules, samples as expected")


def golden_tables() -> list[str]:
    """What is found in the samples and was not expected."""
    from tools.golden import CASES, differences, expected, rows

    wrong = []
    for sample, profile in CASES:
        with tempfile.TemporaryDirectory() as folder:
            found = rows(sample, profile, Path(folder))
        wrong += [f"{sample}, {profile}: {line}" for line in differences(found, expected(sample, profile))]
    return wrong


if __name__ == "__main__":
    main()
