"""`lidarcli info`: what is in a log or a background, as text for people, and as the JSON that programs read."""

import json
import math
import shlex
from collections.abc import Sequence
from datetime import UTC
from itertools import accumulate, chain
from os import fspath
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated, Any

import click

from lidarcli.cli.background import background_dict, background_line, background_lines
from lidarcli.cli.commands import command, log_options
from lidarcli.cli.messages import MessageWriter, chosen_logs, frame_words, line_of, lines_of_page, print_reads, progress_bar
from lidarcli.display.screen import one_line
from lidarcli.display.texts import alike, counted, moment, no_command
from lidarcli.files.stores import Place, place
from lidarcli.options.common import ManyLogs, Overwrite, TextOrJson, output
from lidarcli.options.forms import Option, OptionRule, Text
from lidarcli.options.groups import FINDINGS, Inspecting
from lidarcli.options.times import is_date
from lidarcli.options.values import OUTPUT
from lidarcli.sweeps.findings import LEVELS

if TYPE_CHECKING:
    from lidarcli.logs.base import Topic
    from lidarcli.logs.clock import ClockInfo
    from lidarcli.options.times import TimeZone
    from lidarcli.pipeline.building import Learned
    from lidarcli.pipeline.inspecting import LogInfo, ScanInfo, Span
    from lidarcli.pipeline.runs.over_logs import Failure
    from lidarcli.sweeps.findings import Finding


class InfoCommand(ManyLogs, TextOrJson, Overwrite, Inspecting, total=False):
    output: Annotated[
        tuple[str, ...],
        output("FILE", shown="none", several=True),
        "File to write, how to fix a log: .toml for --mask, .yaml for laser_filters of ROS; may be repeated.",
    ]
    brief: Annotated[
        bool,
        Option(OUTPUT, None, False),
        "One line per log: format, time span, and each topic with its sweeps, beams and rate. No path is judged.",
    ]
    check: Annotated[
        tuple[str, ...],
        Option(FINDINGS, Text("EXPR", has_blanks=True), (), shown="none", several=True),
        "Condition on the findings of all logs, may be repeated: findings.errors == 0; else exit code 1.",
    ]


@command(
    InfoCommand,
    examples="""\
  lidarcli info run.mcap
  lidarcli info bags/ --brief
  lidarcli info bags/ --format json | jq '.[].scans[].rate'
  lidarcli info run.bag --topic /scan --deep -o robot.toml -o filter.yaml
  lidarcli info ranges.csv --fov 270 --degrees --range-unit mm
  lidarcli info run.bag --mask auto -o robot.toml
  lidarcli info bags/ --check "findings.errors == 0"
  lidarcli info bags/ --map site.yaml --check "findings.lost == 0"
  lidarcli info empty.background.parquet
  lidarcli info --help-all""",
    rules=[
        OptionRule(("brief",), ("format=text",), "is for text; leave it out for json", needs=True),
        OptionRule(
            ("output",), ("deep", "mask=auto"), "writes what is learned from a log: add --mask auto or --deep", needs=True
        ),
    ],
)
def info(messages: MessageWriter, options: InfoCommand) -> int:
    """Show what is in a log, and what is wrong with it.

    Reads every log from end to end: topics, sweeps, times, poses, damage and faults. LOG
    may also be a background (docs/background.md): its sensors, stations, beams and origin.
    JSON is a list with one object per LOG.
    """
    brief, deep, outputs = options["brief"], options["deep"], options["output"]
    site = (options["map"] and fspath(options["map"])) or None
    read, opening, poses = log_options(options)

    from lidarcli.errors import CHECK_FAILED, UnreadableError
    from lidarcli.files.newfiles import refuse
    from lidarcli.pipeline.inputs.search import files_of
    from lidarcli.pipeline.inspecting import FIXES, LogInfo, inspect_logs, judge_checks, understand_checks
    from lidarcli.pipeline.reading.needs import Need
    from lidarcli.pipeline.runs.over_logs import Failure, exit_code

    checks = understand_checks(options["check"], deep, site is not None)
    paths = [place(name) for name in outputs]
    if unknown := [name for name, path in zip(outputs, paths, strict=True) if path.suffix not in FIXES]:
        raise click.UsageError(f"-o {unknown[0]}: the suffix is none of {', '.join(FIXES)}")
    sources = chosen_logs(messages, options)
    if paths and len(sources) != 1:
        raise click.UsageError(f"-o is for one log, and these are {len(sources):,}")
    if options["dry_run"]:
        return print_reads(sources, [str(path) for path in paths])
    if paths:
        refuse(paths, options["overwrite"], files_of(sources))
    need = Need.NONE if brief and not (checks or deep or site) else Need.TOLD
    wanted = {"opening": opening, "read": read, "poses_from": poses, "deep": deep, "site": site, "need": need}
    infos: list[LogInfo | Learned] = []
    codes = []
    with progress_bar(sources, messages) as report:
        for source, result in inspect_logs(sources, report, **wanted):
            codes.append(_show_errors(messages, source.label, result))
            if isinstance(result, Failure):
                continue
            infos.append(result)
            if options["format"] == "text":
                with messages.paused():
                    click.echo(
                        _in_a_line(result, read.time_zone)
                        if brief
                        else ("\n" if len(infos) > 1 else "") + as_text(result, read.time_zone, messages.verbose)
                    )
    if options["format"] == "json":
        click.echo(as_json(infos))
    logs = [each for each in infos if isinstance(each, LogInfo)]
    if infos:
        _write_fixes(messages, logs, paths, options["overwrite"])
    failed = messages.failed(judge_checks(checks, logs))
    # Findings of a log that could not be opened are not known; those of a damaged one only get more.
    if failed and len(infos) == len(sources):
        return CHECK_FAILED
    for each in infos if checks else ():
        if not (isinstance(each, LogInfo) and each.scans):
            messages.error("incomplete", f"{each.path}: no sweep was read, and the checks saw nothing of it")
            codes.append(UnreadableError.exit_code)
    return exit_code(codes)


def _write_fixes(messages: MessageWriter, logs: Sequence["LogInfo"], paths: Sequence[Place], overwrite: bool) -> None:
    """Write how to fix the log, where there is anything to fix."""
    from lidarcli.files.newfiles import write_whole
    from lidarcli.pipeline.inspecting import fix_text

    for path in paths:
        if logs and (text := fix_text(logs[0], path.suffix)):
            messages.notes(write_whole(path, text.encode(), overwrite))
            messages.wrote([path])
        else:
            messages.info(f"{path} is not written: there is nothing to fix")


def _show_errors(messages: MessageWriter, label: str, result: "LogInfo | Learned | Failure") -> int:
    """Show what went wrong with a log, and return its exit code."""
    from lidarcli.pipeline.inspecting import LogInfo
    from lidarcli.pipeline.runs.over_logs import Failure

    if isinstance(result, Failure):
        if result.trace:
            messages.bug(result.trace)
        messages.error(label, result.error)
        return result.exit_code
    if not isinstance(result, LogInfo):
        return 0
    for line in result.warnings:
        messages.error(label, line)
    return result.exit_code


_SCREEN = 30
"""Lines of findings that are shown."""
_OTHERS = 10
"""Topics without sweeps or poses that are shown."""
_BRIEF = 4
"""Topics with sweeps that one line shows."""
_FRAMES = 2
"""Pairs of frames shown of one topic."""
_CLOSURES = {"open": "partial view", "closed": "full turn", "shared": "full turn; first and last beam point the same way"}


def as_text(info: "LogInfo | Learned", zone: "TimeZone" = UTC, every: bool = False) -> str:
    """Lines of at most 80 columns, but for names that are longer; `every`: all findings, each by itself."""
    from lidarcli.pipeline.inspecting import LogInfo

    # Names come from a log and may hold anything.
    lines = _log_lines(info, zone, every) if isinstance(info, LogInfo) else background_lines(info)
    return "\n".join(no_command(one_line(line)) for line in lines)


def _in_a_line(info: "LogInfo | Learned", zone: "TimeZone") -> str:
    from lidarcli.pipeline.inspecting import LogInfo

    return no_command(one_line(_log_line(info, zone) if isinstance(info, LogInfo) else background_line(info)))


def _log_lines(info: "LogInfo", zone: "TimeZone", every: bool) -> list[str]:
    lines = [
        info.path,
        line_of("format", f"{info.format}, compression {info.compression}"),
        line_of("size", "unknown" if info.size is None else f"{info.size:,} bytes"),
    ]
    lines += [
        line_of("" if index else "parts", f"{part.name} ({part.size:,} bytes)") for index, part in enumerate(info.parts)
    ]
    lines += [line_of("" if index else "topics", text) for index, text in enumerate(_topics(info.topics))]
    lines += _pose_lines(info)
    lines += [line_of("note", note) for note in info.notes]
    lines += [line_of("damage", damage) for damage in info.damage]
    for scan in info.scans:
        lines += _scan_lines(scan, zone)
    lines += _findings(info, every)
    if (words := info.mends) and info.format.startswith(("mcap", "ros")) and not info.parts and info.size is not None:
        path = PurePath(info.path)
        names = " -o ".join(shlex.quote(str(each)) for each in (path, path.with_name(f"{path.stem}.mended{path.suffix}")))
        lines += ["  to mend them in a copy:", f"    lidarcli clean {names} --mend {','.join(words)}"]
    return lines


def _log_line(info: "LogInfo", zone: "TimeZone") -> str:
    """The log, its format, how long it takes, the sweeps of its topics, and what else there is to read."""
    parts = [info.format]
    if info.scans:
        begin = min((scan.clock.start_ns for scan in info.scans if scan.clock.start_ns is not None), default=0)
        since = f" from {moment(begin, zone)}" if is_date(begin) else ""
        parts.append(f"{max(scan.clock.span for scan in info.scans):.1f} s{since}")
    for scan in info.scans[:_BRIEF]:
        rate = "" if scan.clock.rate is None else f" at {scan.clock.rate:.2f} Hz"
        parts.append(f"{scan.topic} {scan.sweeps:,} x {_span(scan.beams, '{:,.0f}')} beams{rate}")
    if (more := len(info.scans) - _BRIEF) > 0:
        parts.append(f"{more:,} more")
    if not info.scans:
        parts.append("no sweeps")
    else:
        parts.append("poses" if any(scan.pose for scan in info.scans) else "no poses")
    if info.notes:
        parts.append(counted(len(info.notes), "note"))
    if info.findings:
        parts.append(counted(len(info.findings), "finding"))
    if info.damage:
        parts.append("damaged")
    return f"{info.path}: {', '.join(parts)}"


def _topics(topics: Sequence["Topic"]) -> list[str]:
    """The topics that matter here, and the first few of the others: some logs have hundreds."""
    from lidarcli.logs.base import CLOUD_TYPES, POSE_TYPES

    lines = []
    others = 0
    for topic in topics:
        known = topic.is_scan or topic.type in POSE_TYPES | CLOUD_TYPES
        others += not known
        if known or others <= _OTHERS:
            count = "" if topic.messages is None else f"  {topic.messages:,}"
            lines.append(f"{topic.name}  {topic.type}{count}")
    if (more := others - _OTHERS) > 0:
        lines.append(f"and {more:,} other topic{'' if more == 1 else 's'} (--format json lists all)")
    return lines or ["none"]


def as_json(infos: Sequence["LogInfo | Learned"]) -> str:
    """A list with one object per log or background; angles in radians, ranges in metres, times in seconds."""
    from lidarcli.pipeline.inspecting import LogInfo, info_dict

    values = [info_dict(info) if isinstance(info, LogInfo) else background_dict(info) for info in infos]
    text = json.dumps(values, indent=2, ensure_ascii=False)
    # File names need not be UTF-8; what is not has its escape in JSON too.
    return text.encode(errors="backslashreplace").decode()


def _findings(info: "LogInfo", every: bool) -> list[str]:
    """Lines of the findings, the most harmful first: one of those that are alike, a screen at most; or `every` one."""
    order = sorted(info.findings, key=lambda each: LEVELS.index(each.level))
    told = [(f"{each.level:<9}{each.id:<11}{each.message}", _fix_lines(each)) for each in order]
    blocks = [
        [*lines_of_page(f"  {line[:20]}", line[20:]), *(f"    {one}" for one in below.splitlines())]
        for line, below in (told if every else alike(told))
    ]
    last = len(blocks) if every else max(sum(total <= _SCREEN for total in accumulate(map(len, blocks))), 1)
    more = [f"  and {counted(len(blocks) - last, 'more finding')}: lidarcli -v info ... shows all"]
    return [*(["  findings"] if told else []), *chain(*blocks[:last]), *(more if last < len(blocks) else [])]


def _fix_lines(found: "Finding") -> str:
    """The fix of a finding, below its line."""
    if found.fix is None:
        return ""
    # A mask takes many lines, and a file.
    text = "--mask FILE.toml, which -o FILE.toml writes" if found.fix.kind == "mask" else found.fix.text
    return text if found.fix.kind == "transform" else f"fix: {text}"


def _pose_lines(info: "LogInfo") -> list[str]:
    """One line per pose topic with what it holds, and one with its frames."""
    sources = {source.topic: source for source in info.pose_sources}
    lines = []
    for name in info.pose_topics:
        if (source := sources.get(name)) is None:
            lines.append(line_of("poses", name))
            continue
        rate = "" if source.rate is None else f", {source.rate:.2f} Hz, {source.span:.3f} s"
        lines.append(line_of("poses", f"{name}  {source.poses:,} pose{'' if source.poses == 1 else 's'}{rate}"))
        frames = [" > ".join(part for part in pair if part) for pair in source.frames]
        more = f" and {len(frames) - _FRAMES} more" if len(frames) > _FRAMES else ""
        lines.append(line_of("", f"  {', '.join(frames[:_FRAMES])}{more}"))
    return lines


def _scan_lines(scan: "ScanInfo", zone: "TimeZone") -> list[str]:
    from lidarcli.sweeps.types import worth_telling

    clock = scan.clock
    total = sum(scan.by_status.values())
    lines = [
        f"  {scan.topic} ({frame_words(scan.frame_id)})",
        line_of("sweeps", f"{scan.sweeps:,}", 4),
        line_of("beams", _span(scan.beams, "{:,.0f}"), 4),
        line_of(
            "view",
            f"{_span(scan.view, '{:.2f}', math.degrees)} deg from {_span(scan.angle_min, '{:.2f}', math.degrees)} "
            f"deg, step {_span(scan.increment, '{:.4f}', math.degrees)} deg",
            4,
        ),
        line_of("coverage", ", ".join(_CLOSURES[name] for name in scan.closure), 4),
        line_of("limits", _limits(scan.range_min, scan.range_max), 4),
        line_of("rate", "unknown" if clock.rate is None else f"{clock.rate:.2f} Hz (median step)", 4),
    ]
    if clock.start_ns is not None and clock.end_ns is not None:
        lines.append(line_of("time", f"{moment(clock.start_ns, zone)} to {moment(clock.end_ns, zone)}", 4))
        lines.append(line_of("span", f"{clock.span:.3f} s", 4))
    lines.append(line_of("stamps", _stamps(clock, scan.sweeps), 4))
    if scan.made_of:
        lines.append(line_of("made of", f"point clouds ({scan.made_of})", 4))
    if scan.pose:
        lines.append(line_of("pose", scan.pose, 4))
    for name, count in worth_telling(scan.by_status).items():
        share = f"{count / total:.2%}" if total else "-"
        lines.append(line_of(name.replace("_", " "), f"{count:,} beams ({share})", 4))
    return lines


def _limits(least: "Span", greatest: "Span") -> str:
    """The ranges that the sensor declares; one that has no greatest range writes 0, inf or 3.4e38."""
    from lidarcli.sweeps.range_rules import FARTHEST

    limits = f"{_span(least, '{:g}')} m"
    if not max(least.low, 0) < greatest.high <= FARTHEST:
        return f"from {limits}; the log tells no greatest range"
    return f"{limits} to {_span(greatest, '{:g}')} m"


def _stamps(clock: "ClockInfo", sweeps: int) -> str:
    if clock.zero_stamps == sweeps:
        return f"all are zero{'; the times of the recording are taken' if clock.recorded else ''}"
    parts = ["increasing"]
    if clock.repeated:
        parts = [f"{clock.repeated:,} of {sweeps:,} are those of the sweep before"]
    if not clock.monotonic:
        back = f"go back {clock.times_back(f'{clock.largest_backward:.3f} s')}"
        parts = [back, *parts] if clock.repeated else [back]
    if clock.zero_stamps:
        parts.append(f"{clock.zero_stamps:,} of {sweeps:,} are zero")
    if clock.offset is not None:
        side = "before" if clock.offset < 0 else "after"
        parts.append(f"recorded {abs(clock.offset):.3f} s {side} the header stamp")
    return "; ".join(parts)


def _span(span: "Span", form: str, convert: Any = float) -> str:
    low, high = form.format(convert(span.low)), form.format(convert(span.high))
    return low if low == high else f"{low} .. {high}"
