"""The summary of `detect` and `track` on stderr."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from lidarcli.choices import beams_on
from lidarcli.cli.messages import Messages

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import Nothing, Source
    from lidarcli.pipeline.reading.one_log import RunSummary
    from lidarcli.pipeline.runs.over_logs import Outcome

_WORDS = {"no_return": "no return", "too_close": "too close"}
_COLUMNS = 80
TELLING_SECONDS = 1.0
"""What took less time [s] tells how long a program takes to start, not how fast it reads."""


def show(outcome: Outcome, say: Messages) -> None:
    """What became of one log: errors always, the rest unless quiet."""
    if outcome.trace:
        say.bug(outcome.trace)
    if outcome.remark:
        say.error(outcome.label, outcome.remark)
    if outcome.error:
        say.error(outcome.label, outcome.error)
    if outcome.summary is not None:
        _show_run(outcome.label, outcome.summary, say)


def show_reading(outcome: Outcome, say: Messages) -> None:
    """What became of one log that was only read."""
    if outcome.trace:
        say.bug(outcome.trace)
    if outcome.error:
        say.error(outcome.label, outcome.error)
    if (run := outcome.summary) is not None:
        _show_losses(outcome.label, run, say)
        say.info(f"{outcome.label}: {_count(run.sweeps, 'sweep')}{_damaged(run)}")
        for note in run.notes:
            say.info(f"  note     {note}")


class Total:
    """What a run over several logs has found, added up log by log: of a hundred thousand none is kept."""

    def __init__(self) -> None:
        from lidarcli.pipeline.reading.one_log import RunSummary

        self._found = RunSummary()
        self._logs = 0
        self._failed = 0
        self._skipped = 0
        self._codes: dict[Source | Nothing | None, int] = {}

    def add(self, outcome: Outcome) -> None:
        """Take what became of one log."""
        self._logs += 1
        self._skipped += outcome.skipped
        if outcome.exit_code:
            self._failed += 1
            self._codes[outcome.source] = outcome.exit_code
        if outcome.summary is not None:
            self._found.sweeps += outcome.summary.sweeps
            self._found.add_found(outcome.summary)

    def show(self, say: Messages) -> None:
        """One line over several logs."""
        if self._logs < 2:
            if self._skipped or not self._logs:
                say.info("1 log, done before" if self._skipped else "0 logs")
            return
        failures = f", {self._failed} with errors" if self._failed else ""
        skipped = f", {self._skipped} done before" if self._skipped else ""
        say.info(f"{self._logs} logs{failures}{skipped}: {_counts(self._found)}")

    def exit_code(self, sources: Sequence[Source | Nothing]) -> int:
        """The first exit code that is not zero, in the order of the logs."""
        return next((code for source in sources if (code := self._codes.get(source, 0))), 0)


def _show_run(label: str, run: RunSummary, say: Messages) -> None:
    _show_losses(label, run, say)
    say.info(f"{label}: {_counts(run)}{_damaged(run)}")
    if run.sweeps:
        _say_parts(say, f"  beams    {run.beams:,}: ", run.by_status, run.beams, ("valid",))
        # Agents are there only where things are followed.
        words = beams_on(run.things is not None)
        on = {name: run.by_set[letter] for letter, name in words.items()}
        _say_parts(say, "  on       ", on, run.beams, (*on,))
    say.detail(f"  topics   {', '.join(sorted(run.topics)) or 'none'}")
    say.detail(f"  time     {run.seconds:.3f} s{_speed(run)}")
    for note in run.notes:
        say.info(f"  note     {note}")
    for path in run.outputs:
        say.info(f"  wrote    {path}")


def _show_losses(label: str, run: RunSummary, say: Messages) -> None:
    from lidarcli.logs.options import no_scan_topic

    for line in run.damage:
        say.error(label, line)
    for topic in run.missing_topics:
        say.error(label, no_scan_topic([topic]))


def _counts(run: RunSummary) -> str:
    """What was found: objects of sweeps, and the things that they belong to where these were followed."""
    sweeps = _count(run.sweeps, "sweep")
    if run.things is None:
        return f"{sweeps}, {_count(run.objects, 'object')}"
    objects = f"{_count(run.objects + run.agents, 'object')} ({run.agents:,} of agents)"
    return f"{sweeps}, {objects}, {_count(run.things, 'thing')} ({_count(run.moved, 'agent')})"


def _speed(run: RunSummary) -> str:
    is_told = run.seconds >= TELLING_SECONDS and run.sweeps
    return f", {run.sweeps / run.seconds:,.0f} sweeps/s" if is_told else ""


def _damaged(run: RunSummary) -> str:
    return ", source damaged" if run.damage else ""


def _say_parts(
    say: Messages, head: str, counts: Mapping[str, int], total: int, always: Sequence[str]
) -> None:
    """How many beams are of each kind; kinds that do not occur are left out but for those that `always` matter."""
    parts = [
        f"{_WORDS.get(name, name)} {count:,} ({count / total:.1%})"
        if total
        else f"{_WORDS.get(name, name)} 0"
        for name, count in counts.items()
        if count or name in always
    ]
    line = head + parts[0]
    for part in parts[1:]:
        if len(line) + 2 + len(part) > _COLUMNS - 1:
            say.info(f"{line},")
            line = " " * 11 + part
        else:
            line += f", {part}"
    say.info(line)


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}" + ("" if number == 1 else "s")
