"""Two runs side by side: differences of the figures, and sweeps whose number of objects changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.reports.columns import Origin, Run
from lidarcli.reports.figures import DELTA
from lidarcli.reports.summary import Summary
from lidarcli.reports.wording import number, share
from lidarcli.sweeps import Int64

SHOWN = 10
BINS = "bins"
"""Parameter of tables made of point clouds: beams of a sweep."""
SAME_STAMP = 1_000_000
"""Greatest difference of equal stamps [ns]: programs rewrite them in coarser units."""


@dataclass(frozen=True, slots=True)
class Change:
    """A sweep with another number of objects than in the baseline."""

    log: str
    topic: str
    sweep: int
    before: int
    now: int

    @property
    def difference(self) -> int:
        """Number of objects more than in the baseline."""
        return self.now - self.before


@dataclass(frozen=True, slots=True)
class Comparison:
    """A run beside its baseline."""

    baseline: Summary
    figures: dict[str, float | None]
    """`delta.NAME` of every figure, and the names of `figures.COMPARED`."""
    parameters: tuple[tuple[str, str, str], ...]
    """(name, here, in the baseline) of the parameters that differ."""
    changes: tuple[Change, ...]
    """The greatest first, at most `SHOWN`."""

    @property
    def words(self) -> str:
        """Number of sweeps in which the two runs differ, in words."""
        compared, changed, added, removed = (
            self.figures[name] for name in ("compared_sweeps", "changed_sweeps", "added_sweeps", "removed_sweeps")
        )
        return (
            f"Sweeps in both runs: {number(compared)}, {number(changed)} of them ({share(changed or 0, compared or 0)}) "
            "with another number of objects; "
            f"only here: {number(added)}; only in the baseline: {number(removed)}"
        )


def compare(run: Run, summary: Summary, base_run: Run, baseline: Summary) -> Comparison:
    """Compare two runs. Sweeps are matched by log, topic and index; of one log each, the names of the logs may differ.

    Raises
    ------
    OptionError
        The baseline is of other recordings.
    """
    ids = _identities(run, base_run)
    rows, base_rows = ids
    here, there = run.objects_per_sweep, base_run.objects_per_sweep
    _, mine, theirs = np.intersect1d(rows, base_rows, return_indices=True)
    _refuse_others(run, base_run, mine, theirs)
    difference = here[mine] - there[theirs]
    changed = np.flatnonzero(difference)
    figures: dict[str, float | None] = {
        "compared_sweeps": len(mine),
        "changed_sweeps": len(changed),
        "added_sweeps": len(run.sweeps) - len(mine),
        "removed_sweeps": len(base_run.sweeps) - len(mine),
    }
    for name, value in summary.figures.items():
        before = baseline.figures.get(name)
        figures[DELTA + name] = None if value is None or before is None else value - before
    best = changed[np.argsort(-np.abs(difference[changed]), kind="stable")[:SHOWN]]
    topic, topics = run.sweeps.words("topic")
    sweep = run.sweeps.integers("sweep")
    changes = tuple(
        Change(
            log=run.sources[int(run.sweeps.source[row])].log,
            topic=topics[topic[row]],
            sweep=int(sweep[row]),
            before=int(there[other]),
            now=int(here[row]),
        )
        for row, other in zip(mine[best].tolist(), theirs[best].tolist(), strict=True)
    )
    return Comparison(baseline, figures, _parameters(run.sources, base_run.sources), changes)


def _refuse_others(run: Run, base_run: Run, mine: Int64, theirs: Int64) -> None:
    """Refuse another recording: its sweeps have other stamps, or other numbers of beams, or none is in both runs."""
    if not len(run.sweeps) or not len(base_run.sweeps):
        return
    if not len(mine):
        why = "no sweep is in both: no log and topic of the two agree"
        raise _different(run.sources[0], base_run.sources[0], why)
    stamp, before = (one.sweeps.integers("stamp") for one in (run, base_run))
    beams, beams_before = (one.sweeps.integers("beams") for one in (run, base_run))
    later = np.abs(stamp[mine] - before[theirs]) > SAME_STAMP
    unlike = beams[mine] != beams_before[theirs]
    source = run.sweeps.source[mine]
    times, others, compared = (
        np.bincount(source[chosen], minlength=len(run.sources)) for chosen in (later, later | unlike, slice(None))
    )
    for at in np.flatnonzero(2 * others > compared).tolist():
        log = run.sources[at]
        first = np.flatnonzero((later | unlike) & (source == at))[0]
        other = base_run.sources[int(base_run.sweeps.source[theirs[first]])]
        if not times[at] and log.parameters.get(BINS) != other.parameters.get(BINS):
            raise OptionError(
                f"--baseline: the clouds of {log.log} were read with other numbers of beams (--bins): "
                f"{beams[mine[first]]:,} here, {beams_before[theirs[first]]:,} in the baseline; read both alike"
            )
        why = f"{others[at]:,} of {compared[at]:,} sweeps have other stamps or beams"
        raise _different(log, other, why)


def _different(here: Origin, there: Origin, why: str) -> OptionError:
    """Return the error on tables of which no report can compare the figures."""
    return OptionError(f"--baseline: {here.label} and {there.label} are of different recordings: use lidarcli diff ({why})")


def _identities(run: Run, base_run: Run) -> tuple[Int64, Int64]:
    """Return (S,) a number for each sweep of both runs, equal where log, topic and index are."""
    single = len(run.sources) == len(base_run.sources) == 1
    names: dict[tuple[str, str], int] = {}
    most = max((int(one.sweeps.integers("sweep").max(initial=0)) for one in (run, base_run)), default=0) + 1
    ids = []
    for one in (run, base_run):
        topic, topics = one.sweeps.words("topic")
        logs = np.array([0 if single else _code(names, ("log", source.log)) for source in one.sources])
        codes = np.array([_code(names, ("topic", text)) for text in topics] or [0])
        key = logs[one.sweeps.source] * 1_000_003 + codes[topic]
        ids.append(key.astype(np.int64) * most + one.sweeps.integers("sweep"))
    return ids[0], ids[1]


def _code(names: dict[tuple[str, str], int], name: tuple[str, str]) -> int:
    return names.setdefault(name, len(names))


def _parameters(here: Sequence[Origin], there: Sequence[Origin]) -> tuple[tuple[str, str, str], ...]:
    mine, theirs = _settings(here), _settings(there)
    return tuple(
        (name, mine.get(name, "-"), theirs.get(name, "-"))
        for name in sorted({*mine, *theirs})
        if mine.get(name) != theirs.get(name)
    )


def _settings(sources: Sequence[Origin]) -> dict[str, str]:
    values: dict[str, set[str]] = {}
    for source in sources:
        values.setdefault("lidarcli", set()).add(source.version)
        for name, value in source.parameters.items():
            values.setdefault(name, set()).add(str(value))
    return {name: " | ".join(sorted(found)) for name, found in values.items()}
