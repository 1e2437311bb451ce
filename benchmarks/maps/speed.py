"""Time and memory of `lidarcli map`, as JSON: `python -m benchmarks.maps.speed LONG SWEEPS WIDE NARROW`.

It imports nothing heavy: on Linux the peak memory of a child counts from that of its parent.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.bench import HERE, LIDARCLI, Run, run

REPEATS = 3


def make_map(log: Path, folder: Path, *options: str) -> Run:
    """Map a log, from the start of Python to its end."""
    target = str(folder / "map.yaml")
    return run(LIDARCLI, "-q", "map", str(log), "-o", target, "--overwrite", "--min-move", "0", *options)


def main(long: Path, sweeps: int, wide: Path, narrow: Path) -> None:
    """Measure in turns, so that a busy machine hits all alike."""
    mapped, iterated = [], []
    with tempfile.TemporaryDirectory(prefix="lidarcli-maps-") as name:
        folder = Path(name)
        for _ in range(REPEATS):
            # All messages, those that tell the poses among them.
            others = run(sys.executable, str(HERE / "references.py"), "iterate", str(long))
            iterated.append(float(others.output.split()[0]))
            mapped.append(make_map(long, folder).seconds)
        peaks = [make_map(log, folder).peak_mb for log in (wide, narrow)]
    figures = {"per_second": sweeps / median(mapped), "iterate": median(mapped) / median(iterated), "peak_mb": peaks}
    print(json.dumps(figures))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), Path(sys.argv[4]))
