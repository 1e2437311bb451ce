"""Files of changes: tables, pictures, JUnit; and checks on their numbers."""

from __future__ import annotations

from collections.abc import Sequence

from lidarcli.errors import OptionError
from lidarcli.files.newfiles import NewFiles, refuse, writing
from lidarcli.files.stores import Place
from lidarcli.options import choices
from lidarcli.pipeline.differences.changes import Difference
from lidarcli.pipeline.differences.inputs import Input
from lidarcli.pipeline.differences.runs import DiffOptions
from lidarcli.reports.changes import pairs_of
from lidarcli.reports.checks import Check, Verdict, parse_check, verdict_of
from lidarcli.reports.figures import OF_CHANGES, OF_MAPS
from lidarcli.reports.programs import as_junit
from lidarcli.tabular.schemas import CHANGES
from lidarcli.tabular.writing import write_stream

TABLES = {".parquet": "parquet", ".csv": "csv"}
PICTURE = ".png"


# Outputs.


def refuse_outputs(outputs: Sequence[Place], inputs: Sequence[Input], options: DiffOptions) -> None:
    """Refuse outputs of an unknown suffix (`OptionError`), that exist or are an input, before any work."""
    known = (*TABLES, PICTURE, choices.JUNIT)
    for path in outputs:
        if path.suffix.lower() not in known:
            raise OptionError(f"{path}: the suffix of an output has to be one of {', '.join(known)}")
    sources = [one.source for one in inputs if one.source is not None]
    refuse(outputs, options.overwrite, [*options.detect.inputs(sources), *(file for one in inputs for file in one.files)])


def write_changes(
    found: Difference, outputs: Sequence[Place], overwrite: bool, verdicts: Sequence[Verdict] = ()
) -> list[str]:
    """Write the changes as tables and pictures, and the verdicts of checks; returns notes."""
    notes: list[str] = []
    with NewFiles(outputs, overwrite) as new:
        for path in outputs:
            suffix, part = path.suffix.lower(), new.part(path)
            with writing(path):
                if suffix == PICTURE:
                    from lidarcli.reports.map_picture import Sight, draw_changes

                    sights = [Sight(step.ground, step.sensors) for step in found.steps]
                    part.write_bytes(draw_changes(pairs_of(found.changes), sights))
                elif suffix == choices.JUNIT:
                    title = ", ".join([found.steps[0].before, *(step.name for step in found.steps)])
                    part.write_bytes(as_junit("diff", title, verdicts, found.figures, found.damage, found.lines).encode())
                else:
                    table = found.changes.combine_chunks()
                    metadata = dict(table.schema.metadata)
                    with part.open("wb") as out:
                        notes += write_stream(out, TABLES[suffix], str(path), CHANGES, metadata, table.to_batches())[1]
        return notes + new.publish()


def parse_checks(expressions: Sequence[str]) -> list[Check]:
    """Understand checks, or raise `OptionError`."""
    return [parse_check(each, only=(*OF_CHANGES, *OF_MAPS)) for each in expressions]


def judged(found: Difference, checks: Sequence[Check]) -> list[Verdict]:
    """Hold checks against the figures."""
    return [verdict_of(check, found.figures.get(check.name)) for check in checks]
