"""The changes between runs: their rows, their lines for people, and files of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.errors import CHECK_FAILED, OptionError, UnreadableError
from lidarcli.files.newfiles import NewFiles, refuse, writing
from lidarcli.files.stores import Place
from lidarcli.formalism.matching.differences import GONE, HIDDEN, MOVED, NEW, OUT_OF_VIEW, POSES, STRUCTURE, FoundChange
from lidarcli.formalism.matching.free_space import SpaceMap, SpaceMotion
from lidarcli.options import choices
from lidarcli.pipeline.differences.alignment import AlignmentStep
from lidarcli.pipeline.differences.inputs import Input
from lidarcli.pipeline.differences.runs import DiffOptions, ObservedRun, known_or_none
from lidarcli.reports.checks import Check, CheckVerdict, parse_check, verdict_of
from lidarcli.reports.figures import OF_CHANGES, OF_MAPS
from lidarcli.reports.programs import as_junit
from lidarcli.reports.run_pairs import pairs_of
from lidarcli.tabular.schemas import CHANGES
from lidarcli.tabular.streams import write_stream

TABLES = {".parquet": "parquet", ".csv": "csv"}
MAX_LISTED = 10
"""Most objects of a run, and changes of structure, that are listed for people."""


@dataclass(slots=True)
class Difference:
    """The changes of all runs; `changes` has the schema `lidarcli.tabular.schemas.CHANGES`."""

    changes: pa.Table
    steps: tuple[AlignmentStep, ...]
    figures: dict[str, float | None]
    notes: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()
    verdicts: list[CheckVerdict] = field(default_factory=list)

    def judge(self, checks: Sequence[Check]) -> None:
        """Hold checks against the figures."""
        self.verdicts = [verdict_of(check, self.figures.get(check.name)) for check in checks]

    @property
    def exit_code(self) -> int:
        """1 where a check fails, 3 where a run was read in part, else 0."""
        if not all(each.holds for each in self.verdicts):
            return CHECK_FAILED
        return UnreadableError.exit_code if self.damage else 0

    @property
    def lines(self) -> list[str]:
        """The result for people."""
        rows = self.changes.to_pylist()
        found = []
        for step in self.steps:
            found.append(step.how if len(self.steps) == 1 else f"{step.before} to {step.name}: {step.how}")
            found += _lines_of([row for row in rows if row["log_b"] == step.name])
        if (f1 := self.figures.get("f1")) is not None:
            found.append(f"  precision {self.figures['precision']:.4f}, recall {self.figures['recall']:.4f}, f1 {f1:.4f}")
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        alignments = [step.alignment() for step in self.steps]
        changes = self.changes.to_pylist()
        found = {"figures": self.figures, "alignments": alignments, "changes": changes, "notes": [*self.notes]}
        checks = [each.as_dict() for each in self.verdicts]
        return {"exit_code": self.exit_code, "holds": not self.exit_code, "checks": checks, **found}


def _lines_of(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the changes of one run for people."""
    counted = Counter(row["status"] for row in rows)
    whys = Counter(row["why"] for row in rows if row["why"])
    words = [f"{status} {counted[status]}" for status in choices.CHANGE_STATUSES if counted[status]]
    if whys:
        words[-1] += f" ({', '.join(f'{whys[why]} {why}' for why in choices.CHANGE_WHYS if whys[why])})"
    found = [f"  {', '.join(words)}" if words else "  nothing stands in them, and no structure differs"]
    things, structure = [], []
    # What is sure comes first.
    for row in sorted(rows, key=lambda row: row["why"] is not None):
        x, y = (row[f"{axis}_a"] if row[f"{axis}_b"] is None else row[f"{axis}_b"] for axis in ("x", "y"))
        where = f"({x:.1f}, {y:.1f})"
        if row["kind"] == choices.CHANGE_KINDS[STRUCTURE]:
            drift = f" ({row['why']} of {row['moved']:.2f} m)" if row["moved"] else ""
            structure.append(f"{row['status']} {row['length']:.1f} m at {where}{drift}")
        elif row["status"] in tuple(choices.CHANGE_STATUSES[code] for code in (MOVED, NEW, GONE)):
            sizes = " x ".join(f"{row[size]:.1f}" for size in ("length", "width") if row[size] is not None)
            moved = "at" if row["moved"] is None else f"by {row['moved']:.2f} m to"
            names = (row["status"], row["label"], sizes and f"{sizes} m", moved, where)
            things.append("  " + " ".join(word for word in names if word))
    found += things[:MAX_LISTED]
    if len(things) > MAX_LISTED:
        found.append(f"  and {len(things) - MAX_LISTED} more")
    if len(structure) > MAX_LISTED:
        structure[MAX_LISTED:] = [f"and {len(structure) - MAX_LISTED} more"]
    return [*found, f"  structure: {', '.join(structure)}"] if structure else found


def rows_of(
    changes: Sequence[FoundChange],
    before: ObservedRun,
    now: ObservedRun,
    motion: SpaceMotion,
    grounds: Sequence[tuple[str, SpaceMap | None]],
) -> list[dict[str, Any]]:
    """Return the rows of the table, without their numbers."""
    found = []
    old, new = before.run.things, now.run.things
    x, y = motion.of(new.x, new.y)
    counted = [(ground := each.run.ground) is not None and ground.counted for each in (before, now)]
    for change in changes:
        i, j = change.first, change.second
        looks = [count if known and count >= 0 else None for count, known in zip(change.looks, counted, strict=True)]
        row: dict[str, Any] = {
            "log_b": now.name,
            "kind": choices.CHANGE_KINDS[change.kind],
            "status": choices.CHANGE_STATUSES[change.status],
            "why": None if change.why < 0 else choices.CHANGE_WHYS[change.why],
            "score": change.score,
            "area": known_or_none(change.area),
            "sweeps_a": looks[0],
            "sweeps_b": looks[1],
            "free_a": known_or_none(change.free[0]),
            "free_b": known_or_none(change.free[1]),
        }
        if change.kind == STRUCTURE:
            px, py, yaw, length, width = change.place
            run = "b" if change.status == NEW or change.free[0] > 0 else "a"
            row |= {f"x_{run}": px, f"y_{run}": py, f"yaw_{run}": yaw, "length": length, "width": width}
            where = px, py
        else:
            if i >= 0:
                where = float(old.x[i]), float(old.y[i])
                row |= {"x_a": where[0], "y_a": where[1], "yaw_a": _line(before.run.yaw[i])}
                row |= {"track_a": before.track[i] or None, "label": before.label[i]}
            if j >= 0:
                where = float(x[j]), float(y[j])
                row |= {"x_b": where[0], "y_b": where[1], "yaw_b": _line(now.run.yaw[j] + motion.angle)}
                row |= {"track_b": now.track[j] or None, "label": now.label[j] or row.get("label")}
            if i >= 0 and j >= 0:
                row["moved"] = math.hypot(row["x_b"] - row["x_a"], row["y_b"] - row["y_a"])
                row["turned"] = _line(row["yaw_b"] - row["yaw_a"])
            things, k = (new, j) if j >= 0 else (old, i)
            row |= {"length": known_or_none(things.length[k]), "width": known_or_none(things.width[k])}
        row["moved"] = known_or_none(change.drift) or row.get("moved")
        at = np.array([where]).T
        if change.why in (HIDDEN, OUT_OF_VIEW) and now.before is not None and now.before.seen(*motion.inverse.of(*at))[0]:
            row["why"] = choices.CHANGE_WHYS[POSES]
        # The latest run that observed the place; where none did, the latest.
        seeing = [name for name, ground in grounds if ground is not None and ground.seen(*at)[0]]
        row["log_a"] = before.log[i] if i >= 0 else [*seeing, grounds[0][0]][0]
        found.append(row)
    return found


def _line(angle: float) -> float:
    """Return an angle of an undirected line, -π/2 to π/2."""
    return float(0.5 * math.pi - (0.5 * math.pi - angle) % math.pi)


def refuse_outputs(outputs: Sequence[Place], inputs: Sequence[Input], options: DiffOptions) -> None:
    """Refuse outputs of an unknown suffix (`OptionError`), that exist or are an input, before any work."""
    known = (*TABLES, ".png", choices.JUNIT)
    for path in outputs:
        if path.suffix.lower() not in known:
            raise OptionError(f"{path}: the suffix of an output has to be one of {', '.join(known)}")
    sources = [one.source for one in inputs if one.source is not None]
    refuse(outputs, options.overwrite, [*options.detect.inputs(sources), *(file for one in inputs for file in one.files)])


def write_changes(found: Difference, outputs: Sequence[Place], overwrite: bool, runs: Sequence[str] = ()) -> list[str]:
    """Write the changes of the `runs` as tables and pictures, and the verdicts of checks; returns notes."""
    notes: list[str] = []
    with NewFiles(outputs, overwrite) as new:
        for path in outputs:
            suffix, part = path.suffix.lower(), new.part(path)
            with writing(path):
                if suffix == ".png":
                    from lidarcli.reports.map_picture import Backdrop, draw_changes

                    sights = [Backdrop(step.ground, step.sensors) for step in found.steps]
                    part.write_bytes(draw_changes(pairs_of(found.changes), sights))
                elif suffix == choices.JUNIT:
                    told = (found.verdicts, found.figures, found.damage, found.lines)
                    part.write_bytes(as_junit("diff", ", ".join(runs), *told, logs=runs).encode())
                else:
                    table = found.changes.combine_chunks()
                    metadata = dict(table.schema.metadata)
                    with part.open("wb") as out:
                        notes += write_stream(out, TABLES[suffix], str(path), CHANGES, metadata, table.to_batches())[1]
        return notes + new.publish()


def parse_checks(expressions: Sequence[str]) -> list[Check]:
    """Understand checks, or raise `OptionError`."""
    return [parse_check(each, only=(*OF_CHANGES, *OF_MAPS)) for each in expressions]
