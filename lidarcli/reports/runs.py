"""A report on runs: outcomes of their logs, and the reasons why logs failed or are damaged."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from lidarcli.display import stamp
from lidarcli.reports.document import MARKDOWN, PAGE, TEXT, Card, Case, Document, Facts, Listing, Section, Share, Table
from lidarcli.reports.figures import Figure
from lidarcli.reports.wording import counted, number, share
from lidarcli.tabular.runs import DAMAGED, FAILED, OUTCOMES, Entry, newest

BAD = {FAILED: "Failed logs", DAMAGED: "Damaged logs"}
"""Outcomes that are listed log by log, each with its heading."""
FIGURES: dict[str, Figure] = {
    "logs": Figure("1", "logs, each as its newest run left it"),
    "ok": Figure("1", "logs that were read whole"),
    "damaged": Figure("1", "logs that were read as far as they can be"),
    "failed": Figure("1", "logs without tables"),
    "bytes": Figure("byte", "size of all logs, as far as it is known"),
    "sweeps": Figure("1", "sweeps that were read"),
    "rows": Figure("1", "rows of all tables"),
    "seconds": Figure("s", "time that the logs took, summed over all of them"),
    "sweeps_per_second": Figure("1/s", "sweeps by these seconds"),
    "runs": Figure("1", "runs: manifests that were read"),
}
"""The figures of a report on runs, each with its unit and meaning."""
MESSAGES, LOGS = 20, 10
"""Most messages of an outcome, and most logs of a message, that text and Markdown show; the JSON holds all."""
MESSAGES_OF_PAGE, LOGS_OF_PAGE = 200, 100
"""Most messages and logs that a page shows."""


@dataclass(frozen=True, slots=True)
class Group:
    """Logs of one outcome for one reason."""

    outcome: str
    exit_code: int
    message: str
    logs: tuple[Entry, ...]

    @property
    def words(self) -> str:
        """Number of logs and reason."""
        return f"{counted(len(self.logs), 'log')}, exit code {self.exit_code}: {self.message}"


@dataclass(frozen=True, slots=True)
class RunsSummary:
    """The figures of the runs, and the newest row of each log."""

    figures: dict[str, float | None]
    logs: tuple[Entry, ...]
    """Sorted by URL."""
    versions: tuple[str, ...]

    def groups(self, outcome: str) -> list[Group]:
        """Return the logs of an outcome by their message, the most frequent first."""
        found: dict[tuple[int, str], list[Entry]] = defaultdict(list)
        for log in self.logs:
            if log.outcome == outcome:
                found[log.exit_code, log.message or "no message"].append(log)
        groups = [Group(outcome, code, message, tuple(logs)) for (code, message), logs in found.items()]
        return sorted(groups, key=lambda group: (-len(group.logs), group.exit_code, group.message))

    @property
    def span(self) -> tuple[int, int] | None:
        """Times at which the first and the last log were done [ns since 1970]; None without logs."""
        ended = [log.ended for log in self.logs]
        return (min(ended), max(ended)) if ended else None


@dataclass(frozen=True, slots=True)
class RunsReport(Document):
    """A report on runs."""

    summary: RunsSummary

    @property
    def title(self) -> str:
        """Subject of the report in a few words."""
        figures = self.summary.figures
        return f"{counted(figures['runs'], 'run')} over {counted(figures['logs'], 'log')}"

    @property
    def figures(self) -> dict[str, float | None]:
        """Figures of the runs by name."""
        return self.summary.figures

    @property
    def cases(self) -> tuple[Case, ...]:
        """One case per log; a log that failed or is damaged is a failure."""
        return tuple(Case(log.url, "lidarcli.runs", _failure(log), log.outcome, log.seconds) for log in self.summary.logs)

    def sections(self) -> dict[str, Section]:
        """Return the sections by name, in their order."""
        summary, facts = self.summary, _facts(self.summary)
        figures, total = summary.figures, len(summary.logs)
        shares = [(name, Share(int(figures[name] or 0), total)) for name in OUTCOMES]
        names = ("logs", *OUTCOMES)
        numbers = Table(names, [[number(figures[name]) for name in names]], range(len(names)))
        sections = {
            "text": Section(self.title.capitalize(), [Facts([*shares, *facts])], (TEXT,)),
            "markdown": Section("", [numbers, Facts(facts)], (MARKDOWN,)),
            "page": Section("Runs", [Facts(facts)], (PAGE,)),
        }
        for outcome, title in BAD.items():
            if groups := summary.groups(outcome):
                sections[outcome] = Section(title, [_listing(groups)], (TEXT, MARKDOWN))
                sections[f"page of {outcome}"] = Section(title, [_table(groups)], (PAGE,))
        return sections

    def cards(self) -> list[Card]:
        """Return the outcomes, and the checks."""
        figures, total = self.summary.figures, len(self.summary.logs)
        cards = [Card("logs", number(figures["logs"]), f"{number(figures['bytes'])} bytes")]
        for name in OUTCOMES:
            count = figures[name] or 0
            cards.append(Card(name, number(count), share(count, total), alarming=name in BAD and count > 0))
        return [*cards, *self.check_cards()]

    @property
    def lines(self) -> tuple[str, ...]:
        """Number of logs by outcome."""
        figures = self.summary.figures
        ends = ", ".join(f"{number(figures[name])} {name}" for name in OUTCOMES)
        return (f"{self.title}: {ends}, {counted(figures['sweeps'], 'sweep')}",)


def _failure(log: Entry) -> str | None:
    if log.outcome not in BAD:
        return None
    return f"{log.outcome}, exit code {log.exit_code}: {log.message or 'no message'}"


def summarise_runs(rows: Iterable[Entry], runs: int) -> RunsSummary:
    """Sum up rows of `runs` manifests; of several rows of a log that which ended last counts."""
    last = newest(rows)
    logs = tuple(last[url] for url in sorted(last))
    outcomes = Counter(log.outcome for log in logs)
    sweeps = sum(log.sweeps or 0 for log in logs)
    seconds = sum(log.seconds or 0.0 for log in logs)
    figures: dict[str, float | None] = {
        "logs": len(logs),
        **{outcome: outcomes[outcome] for outcome in OUTCOMES},
        "bytes": sum(log.size or 0 for log in logs),
        "sweeps": sweeps,
        "rows": sum(log.rows or 0 for log in logs),
        "seconds": seconds,
        "sweeps_per_second": sweeps / seconds if seconds > 0 else None,
        "runs": runs,
    }
    return RunsSummary(figures, logs, tuple(sorted({log.version for log in logs})))


def _facts(summary: RunsSummary) -> list[tuple[str, str | Share]]:
    """Return (name, words): the work that was done, by which versions and when."""
    figures, span = summary.figures, summary.span
    facts = {
        "runs": number(figures["runs"]),
        "lidarcli": ", ".join(summary.versions),
        "from": stamp(span[0]) if span else "",
        "to": stamp(span[1]) if span else "",
        "size": f"{number(figures['bytes'])} bytes",
        "sweeps": number(figures["sweeps"]),
        "rows": number(figures["rows"]),
        "work": f"{number(figures['seconds'])} s",
        "rate": f"{number(figures['sweeps_per_second'])} sweeps per second of work",
    }
    return [(name, words) for name, words in facts.items() if words]


def _shown(groups: list[Group], messages: int, logs: int) -> list[tuple[Group, list[str]]]:
    """Return the groups that are shown, each with the names of its logs, and how many there are more."""
    shown = []
    for group in groups[:messages]:
        left = len(group.logs) - logs
        shown.append((group, [log.url for log in group.logs[:logs]] + [f"and {left:,} more"] * (left > 0)))
    return shown


def _listing(groups: list[Group]) -> Listing:
    shown = [(group.words, names) for group, names in _shown(groups, MESSAGES, LOGS)]
    return Listing(shown, _left_out(groups[MESSAGES:]))


def _table(groups: list[Group]) -> Table:
    rows = [
        (name, str(group.exit_code), group.message)
        for group, names in _shown(groups, MESSAGES_OF_PAGE, LOGS_OF_PAGE)
        for name in names
    ]
    return Table(("log", "exit code", "message"), rows, (), _left_out(groups[MESSAGES_OF_PAGE:]))


def _left_out(groups: list[Group]) -> str:
    """Return the groups that are not shown, in words; empty without any."""
    if not groups:
        return ""
    logs = counted(sum(len(group.logs) for group in groups), "log")
    return f"and {logs} more with {counted(len(groups), 'other message')}; --format json has all"
