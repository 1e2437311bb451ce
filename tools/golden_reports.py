"""The golden reports: what `report` says of a sample in every format, kept to be compared (`make golden`)."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from lidarcli.cli import run

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "tests" / "golden" / "reports"
SUFFIXES = ("txt", "md", "json", "xml", "html")
CHECKS = (
    "sweeps == 20",
    "objects_per_sweep.p95 <= 3",
    "objects where width > 0.5 and range_min < 1.0 == 0",
    "delta.valid_share between -0.01 and 0.01",
)


def golden_path(suffix: str) -> Path:
    """The file that holds the expected report."""
    return FOLDER / f"room.{suffix}"


def reports(folder: Path) -> dict[str, str]:
    """Suffix → report of two seconds of a room, beside the empty room; `folder` takes the tables."""
    for sample in ("room", "room_empty"):
        log = str(ROOT / "samples" / f"{sample}.mcap")
        # The formulas to the letter: what the estimates of the other profile find changes more often.
        options = ["--profile", "paper", "--max-width", "2", "--end", "1.95"]
        if code := run(["-q", "detect", log, "-o", str(folder), *options]):
            raise SystemExit(f"{log}: exit code {code}")
    found = {}
    for suffix in SUFFIXES:
        out = folder / f"room.{suffix}"
        words = ["-q", "report", str(folder / "room.objects.parquet"), "-o", str(out)]
        words += ["--baseline", str(folder / "room_empty.objects.parquet")]
        words += [word for check in CHECKS for word in ("--check", check)]
        if (code := run(words)) not in (0, 1):
            raise SystemExit(f"report: exit code {code}")
        text = out.read_text("utf-8")
        found[suffix] = plain(text) if suffix == "html" else text
    return found


def plain(page: str) -> str:
    """A page without its style, scripts, data and drawings, which nobody can read in a diff."""
    page = re.sub(r"<style>.*?</style>", "<style></style>", page, flags=re.DOTALL)
    page = re.sub(r"(<script[^>]*>).*?</script>", r"\1</script>", page, flags=re.DOTALL)
    page = re.sub(r"(<svg role=\"img\" aria-label=\"[^\"]*\").*?</svg>", r"\1></svg>", page, flags=re.DOTALL)
    return re.sub(r"sha256-[^']*", "sha256-", page)


def main() -> None:
    """Write every golden report."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for suffix, text in reports(Path(folder)).items():
            golden_path(suffix).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
