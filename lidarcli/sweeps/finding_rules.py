"""The rules of findings, with their thresholds.

`SWEEP_RULES` evaluate `scan_checks.SweepStats` in any command, whose notes they are; `LOG_RULES` evaluate the statistics
`scan_checks.LogStats` that `info` alone collects. The rules of `info --deep` follow, for what `reading.deep` measures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from typing import Any

from lidarcli.sweeps.findings import Finding, Level, Rule, Sensor
from lidarcli.sweeps.types import TURN, spared

FAR = 200.0
"""No 2D LiDAR has mostly ranges above this [m]."""
LONG_RANGE = 60.0
"""No 2D LiDAR has mostly ranges above this [m] and some above `FAR`."""
WIDEST_VIEW = 1.5 * TURN
"""Widest view [rad] that a sweep can have."""
NARROW = 30.0
"""No sensor sees less [degrees]: radians of this many are no degrees."""
UNUSABLE = 0.95
"""Share of beams without a range above which something may be wrong."""
FINEST_STEP = 1e-5
"""No sensor has finer steps between beams [rad]."""
CERTAINLY_MM = 1000.0
"""Ranges in centimetres stay below this number."""
FEW = 0.02
"""Share of the ranges that are some."""
IN_TURNS = 0.3
"""Share of compared sweeps above which two sensors are assumed to alternate."""
LEAST = 6
"""Fewest compared sweeps."""
MEET = 0.8
"""Share of the sweeps of half a turn in which both ends have one range, and correlation of these, from which on they meet:
no robot drives that exactly in the middle of a corridor."""
FASTEST = 1000.0
"""No sensor sweeps faster [Hz]."""
SOME = 3
"""Fewest odd sweeps worth a note, in short logs."""
SET_BACK = 1.0
"""Overtaking messages are never this late [s]."""
LEAP = 3600.0
"""No pause between two sweeps is this long [s]."""
LOST = 0.08
"""Share of NaN, 0 or range_max above which they are reported: REP 117 writes inf for no return.

Topics of public recordings have 5 % and less of them, or 10 % and more.
"""
TOO_CLOSE = 0.01
"""Share of beams below range_min above which something near is missed."""
VIEW_VARIES = 0.05
"""Share by which views differ where sweeps are cut short; beams alone vary with the speed of many a motor."""
OFTEN = 0.05
"""Share of repeated sweeps, or of repeated or decreasing stamps, above which they are no accident."""
LONG = 1.5
"""A step this many times the median one has left out a sweep."""
MISSING = 0.01
"""Share of long steps above which sweeps are missing: no sensor of public recordings has one by chance."""
APART = 1.0
"""Most seconds between header stamp and record time of one clock."""
ASIDE = 0.25
"""Distance in steps from which on a beam lies between those of another sweep; sweeps of one step end nearer."""
OFF = 0.2
"""Deviation of the time of a sweep by `time_increment` from that by view and period, as a share."""
SAME_TOPIC = 0.5
"""Share of the sweeps of a topic that another one has, too."""
MIRRORED = -0.5
"""Correlation of the turns of the poses with those of the sweeps."""
STAMP_OFF = 0.15
"""Greatest distance of the delay from half or all of the time of a sweep, as a share of this."""
MIN_TURN = math.radians(120.0)
"""Turning of the poses from which on they determine a mount [rad], turns to and fro included."""
DEVIATIONS, MIN_OFF, MIN_ASKEW = 3.0, 0.02, math.radians(1.0)
"""A mount is reported that is off by so many deviations and by this [m, rad]."""
FLICKERS = 0.2
"""Share of the steps from sweep to sweep in which a beam changes between valid and no return."""
CODES_BELOW, SOME_CODES = 0.02, 0.001
"""Ranges that no LiDAR measures [m], and the share of the beams from which on they are no accident."""
PACES = 0.9, 1.1
"""A log is recorded as fast as its stamps run, within these."""
OTHERS_VALID = 0.5
"""Median share of valid beams of other sectors, where one has none."""

_TOO_WIDE = "{name} sees {0.view_degrees:,.0f} deg ({0.wide:,} of {0.sweeps:,} sweeps): "
_WIDE = _TOO_WIDE + "degrees written as radians? (--degrees)"
_NO_RANGE = "{name}: {0.without:.1%} of the beams have no range ({0.causes_shown}): {0.remedy}"
_NO_RANGES: tuple[tuple[str, Level, Callable[[Any], Any]], ...] = (
    ("limits", "error", lambda s: s.without > UNUSABLE and s.cause == "above range_max" and not s.has_limit),
    ("too_close", "error", lambda s: s.without > UNUSABLE and s.cause == "below range_min"),
    ("no_return", "warning", lambda s: s.without > UNUSABLE and s.cause and s.cause != "above range_max"),
    ("no_return", "error", lambda s: s.without > UNUSABLE and not s.cause),
)
_AGAIN = "{0.clock.repeated:,} of {0.clock.sweeps:,} sweeps of {name} have "
_REPEATED = "repeated=clock.repeated sweeps=clock.sweeps"
_BACK = "backward=clock.backward largest=clock.largest_backward sweeps=clock.sweeps"
_RANGES = {"no_return", "too_close", "units"}

SWEEP_RULES = (
    Rule(
        "units",
        "error",
        lambda s: s.wide and s.coarse,
        _WIDE,
        "view sweeps=wide",
        {"view": WIDEST_VIEW},
        "--degrees",
        mend="units",
    ),
    Rule(
        "geometry",
        "error",
        lambda s: s.wide and not s.coarse and s.view < NARROW,
        _TOO_WIDE + "angle_increment is too large",
        "view sweeps=wide",
        {"view": WIDEST_VIEW},
    ),
    Rule(
        "geometry",
        "error",
        lambda s: s.wide and not s.coarse and s.view >= NARROW,
        _WIDE,
        "view sweeps=wide",
        {"view": WIDEST_VIEW},
        "--degrees",
        mend="units",
    ),
    Rule(
        "geometry",
        "error",
        lambda s: s.meet > MEET,
        "{name}: its half turn ends where it begins: angle_increment is half of what it should be",
        "meet view",
        {"meet": MEET},
        mend="angles",
    ),
    Rule(
        "geometry",
        "error",
        lambda s: s.fine,
        "beams of {name} are {0.step:.1g} rad apart ({0.fine:,} of {0.sweeps:,} sweeps): none is so fine (text: --fov)",
        "step sweeps=fine",
        {"step": FINEST_STEP},
    ),
    Rule(
        "geometry",
        "warning",
        lambda s: s.off and not s.wide and not s.fine and s.meet <= MEET,
        "angle_max of {name} is {0.ends_degrees[0]:.2f} deg, by angle_increment {0.ends_degrees[1]:.2f} deg: that is used"
        "{0.cut} ({0.off:,} of {0.sweeps:,} sweeps)",
        "angle_max last_beam sweeps=off",
        {"steps": 0.5},
        mend="angles",
    ),
    Rule(
        "geometry",
        "error",
        lambda s: s.sweeps and not s.some,
        "the sweeps of {name} have no beams",
        "beams",
        chain="ranges",
    ),
    Rule(
        "units",
        "error",
        lambda s: s.is_far,
        "most ranges of {name} are beyond {0.far_from:,.0f} m: {0.unit_remedy}",
        "share=far_share",
        {"share": 0.5, "range": "far_limit"},
        "{0.unit_option}",
        "ranges",
        mend="{0.unit_mend}",
    ),
    *(
        Rule(id_, level, holds, _NO_RANGE, "*without_by_cause", {"share": UNUSABLE}, chain="ranges")
        for id_, level, holds in _NO_RANGES
    ),
    Rule(
        "frames",
        "error",
        lambda s: s.turns > IN_TURNS * s.compared and s.compared >= LEAST,
        "sweeps of {name} come from two sensors in turns: --every 2 may take one alone",
        "share=turns_share",
        {"share": IN_TURNS},
        "--every 2",
    ),
    Rule(
        "observed",
        "warning",
        lambda s: s.blind > s.spared and s.beams and s.without < UNUSABLE,
        "{0.blind:,} of {0.sweeps:,} sweeps of {name} have no range at all: they show nothing",
        "sweeps=blind",
        {"sweeps": "spared"},
    ),
    Rule(
        "observed",
        "warning",
        lambda s: s.frozen > s.spared,
        "{0.frozen:,} of {0.sweeps:,} sweeps of {name} repeat an older one bit for bit: the driver hung",
        "sweeps=frozen",
        {"sweeps": "spared"},
    ),
    Rule(
        "no_return",
        "warning",
        lambda s: s.zeros > spared(s.examined),
        "{name}: in {0.zeros_share:.0%} of the sweeps up to {0.zeros_degrees:.0f} degrees in a row are 0 or senseless: "
        "nothing there, or blind (--no-return inf,max takes it so)",
        "share=zeros_share",
        chain="ranges",
    ),
    Rule(
        "duplicate",
        "warning",
        lambda s: s.clock.repeated > s.often and s.copied,
        _AGAIN + "stamp and ranges of the sweep before{0.once}",
        _REPEATED,
        {"repeated": "often"},
        "{0.every}",
        "steps",
    ),
    Rule(
        "clock",
        "error",
        lambda s: s.clock.sweeps > SOME and s.clock.start_ns == s.clock.end_ns,
        "all {0.clock.sweeps:,} sweeps of {name} have one stamp: tracks cannot tell what moves",
        "sweeps=clock.sweeps",
        chain="steps",
        mend="clock",
    ),
    Rule(
        "clock",
        "error",
        lambda s: s.clock.repeated > s.often,
        "{0.clock.repeated:,} of {0.clock.sweeps:,} sweeps of {name} repeat a stamp: speeds are wrong (too coarse, or two "
        "sensors)",
        _REPEATED,
        {"repeated": "often"},
        chain="steps",
        mend="clock",
    ),
    Rule(
        "clock",
        "error",
        lambda s: s.clock.rate is not None and s.clock.rate > FASTEST,
        "stamps of {name} are {0.step_ns:,.0f} ns apart: all speeds are wrong (ms or µs written as ns?)",
        "rate=clock.rate",
        {"rate": FASTEST},
        chain="steps",
        mend="clock",
    ),
    Rule(
        "clock",
        "warning",
        lambda s: len(s.clock.starts) > 1,
        "the clock of {name} starts anew: {0.clock.runs_shown}; path and tracks end at each, --run takes one",
        _BACK,
        {"largest": SET_BACK},
        chain="steps",
    ),
    Rule(
        "clock",
        "error",
        lambda s: s.clock.backward > s.often,
        "stamps of {name} go back {0.back}: out of order, or of two sensors",
        _BACK,
        {"backward": "often"},
        chain="steps",
        mend="stamps",
    ),
    Rule(
        "clock",
        "warning",
        lambda s: s.clock.largest_backward >= SET_BACK,
        "stamps of {name} go back {0.back}: the clock was set",
        _BACK,
        {"largest": SET_BACK},
        chain="steps",
    ),
    Rule(
        "clock",
        "warning",
        lambda s: s.clock.largest_forward > LEAP,
        "stamps of {name} leap ahead by {0.ahead}: {0.clock.leap_remedy}",
        "largest=clock.largest_forward",
        {"largest": LEAP},
        chain="steps",
    ),
    Rule(
        "clock",
        "warning",
        lambda s: s.clock.astray,
        "{0.astray_shown} those around it: times that fit these are taken",
        "astray sweeps=astray_count",
        {"astray": LEAP},
        mend="clock",
    ),
    Rule(
        "clock",
        "warning",
        lambda s: s.clock.recorded,
        "{0.stampless}: the times at which they were recorded are taken for them",
        "zero_stamps=clock.recorded sweeps=clock.sweeps",
        {"zero_stamps": 1},
        mend="clock",
    ),
)
"""Evaluated in this order; their findings are notes of all commands."""

UNEVEN_LISTS = Rule(
    "geometry",
    "warning",
    lambda s: s.uneven,
    "{name}: {0.uneven:,} of {0.sweeps:,} sweeps have {0.span_shown} beams, not {0.usual:,}: lost beams shift all bearings "
    "after them (log the angle: --columns time,angle,range)",
    "sweeps=uneven beams=span usual",
    {"sweeps": 1},
)
"""Of lists of ranges without bearings: a note of all commands, too."""

LOG_RULES = (
    Rule(
        "geometry",
        "warning",
        lambda s: s.counts[0] < s.counts[1] and s.views[0] < (1.0 - VIEW_VARIES) * s.views[1],
        "{name}: {0.counts[0]:,} to {0.counts[1]:,} beams see {0.views_degrees[0]:.0f} to {0.views_degrees[1]:.0f} deg: "
        "some sweeps are cut short",
        "beams=beams_span view=view_span",
        {"share": VIEW_VARIES},
        chain="beams",
        mend="beams",
    ),
    Rule(
        "geometry",
        "hint",
        lambda s: s.counts[0] < s.counts[1] and s.between > OFTEN * s.sweeps,
        "{name}: the beams of {0.between:,} of {0.sweeps:,} sweeps lie between those of the first: slam_toolbox takes no "
        "such sensor",
        "sweeps=between beams=beams_span",
        {"share": OFTEN, "steps": ASIDE},
        chain="beams",
    ),
    Rule(
        "geometry",
        "hint",
        lambda s: s.counts[0] < s.counts[1],
        "{name}: {0.counts[0]:,} to {0.counts[1]:,} beams by sweep: slam_toolbox takes only as many as the first had",
        "beams=beams_span",
        chain="beams",
        mend="beams",
    ),
    Rule(
        "limits",
        "warning",
        lambda s: s.unlimited,
        "{name}: range_max is not above range_min ({0.unlimited:,} of {0.sweeps:,} sweeps): AMCL takes no such sweep, and "
        "others none of its beams",
        "sweeps=unlimited",
        {"sweeps": 1},
        mend="limits",
    ),
    *(
        Rule(
            "no_return",
            "hint",
            lambda s, kind=kind: s.most_lost == kind and s.lost[kind] > LOST,  # type: ignore[misc]
            "{name}: {0.lost[" + kind + "]:.0%} of the beams are " + words,
            "*lost",
            {"share": LOST},
            option,
            unless=_RANGES,
            mend=mend,
        )
        for kind, words, option, mend in (
            ("nan", "NaN (--no-return nan)", "--no-return inf,zero,max,above,pile,nan", ""),
            ("negative", "negative", "--no-return inf,zero,max,above,pile,negative", ""),
            ("zero", "0", "", "no-return"),
            ("range_max", "range_max", "", "no-return"),
        )
    ),
    Rule(
        "too_close",
        "warning",
        lambda s: s.too_close > TOO_CLOSE,
        "{name}: {0.too_close:.0%} of the beams are below range_min",
        "share=too_close",
        {"share": TOO_CLOSE},
        unless=_RANGES,
    ),
    Rule(
        "duplicate",
        "hint",
        lambda s: s.repeats > max(OFTEN * s.compared, SOME),
        "{name}: {0.repeats:,} of {0.compared:,} sweeps repeat the ranges before them",
        "repeats sweeps=compared",
        {"share": OFTEN},
        unless={"clock", "duplicate"},
    ),
    Rule(
        "gaps",
        "hint",
        lambda s: s.is_slow and s.lasts is None and s.clock.long_steps <= MISSING,
        "{name}: a sweep every {0.period:.3f} s, by scan_time every {0.scan_time:.3f} s: a parameter of the driver, as "
        "the steps are even and time_increment is 0",
        "period scan_time",
        {"ratio": LONG},
        chain="period",
        unless={"clock", "duplicate"},
    ),
    Rule(
        "gaps",
        "warning",
        lambda s: s.is_slow,
        "{name}: a sweep every {0.period:.3f} s, by scan_time every {0.scan_time:.3f} s: {0.missing:.0f} of "
        "{0.expected:.0f} are missing",
        "period scan_time",
        {"ratio": LONG},
        chain="period",
        unless={"clock", "duplicate"},
    ),
    Rule(
        "gaps",
        "warning",
        lambda s: s.period is not None and s.clock.long_steps > MISSING and s.clock.long_steps * s.clock.sweeps >= SOME,
        f"{{name}}: {{0.clock.long_steps:.0%}} of the steps are over {LONG} times the median of {{0.period:.3f}} s",
        "share=clock.long_steps period",
        {"share": MISSING, "ratio": LONG},
        chain="period",
        unless={"clock", "duplicate"},
    ),
    Rule(
        "rolling",
        "warning",
        lambda s: s.by_view is not None and abs(s.lasts - s.by_view) > OFF * s.by_view,
        "{name}: a sweep takes {0.lasts_shown} s by time_increment, {0.by_view_shown} s by its view",
        "by_increment=lasts by_period=by_view",
        {"share": OFF},
        "--no-deskew",
        unless={"clock", "duplicate", "geometry", "units"},
        mend="times",
    ),
    Rule(
        "pace",
        "hint",
        lambda s: s.is_paced,
        "{name}: recorded {0.pace:.2f} times as fast as its stamps run: played, or written anew?",
        "pace",
        {"least": PACES[0], "greatest": PACES[1]},
        unless={"clock"},
    ),
    Rule(
        "clock",
        "hint",
        lambda s: s.clock.offset is not None and abs(s.clock.offset) > APART,
        "{name}: recorded {0.offset:,.1f} s {0.side} the stamps",
        "record_minus_header=clock.offset",
        {"record_minus_header": APART},
        unless={"clock"},
        mend="clock",
    ),
    Rule(
        "codes",
        "warning",
        lambda s: s.codes_share > SOME_CODES,
        "{name}: {0.codes_share:.1%} of the beams are {0.codes_span[0]:g} to {0.codes_span[1]:g} m, nearer than any LiDAR "
        "measures: codes of errors?",
        "share=codes_share",
        {"share": SOME_CODES, "range": CODES_BELOW},
        f"--range {CODES_BELOW:g} {{0.farthest:.4g}}",
        unless={"units"},
    ),
    Rule(
        "intensity",
        "warning",
        lambda s: s.reversed_intensities,
        "{name}: intensities run against the ranges: {0.unlike:.1%} of the beams have one without a range or none with "
        "one, {0.unlike_reversed:.1%} if they are reversed",
        "unlike reversed=unlike_reversed",
        mend="intensities",
    ),
    Rule(
        "body",
        "hint",
        lambda s: len(s.body),
        "{name}: {0.body_shown} stay at {0.body_nearest:.2f} to {0.body_farthest:.2f} m while those beyond change: the "
        "robot's own body? (info --deep)",
        "beams=body_beams nearest=body_nearest farthest=body_farthest",
        {"range": 1.0},
    ),
    Rule("frames", "hint", lambda s: s.lacks_frame, "{0.topic}: the sweeps name no frame", mend="frames"),
    Rule("frames", "hint", lambda s: s.slashed, "{name}: tf2 takes no frame whose name begins with /", mend="frames"),
)
"""Evaluated by `info`, after `SWEEP_RULES`."""

REPEATED_TOPIC = Rule(
    "duplicate",
    "warning",
    lambda s: s.same >= SAME_TOPIC * s.fewest,
    "{0.topic} repeats {0.first}: {0.same:,} of {0.sweeps:,} sweeps{0.apart}",
    "same sweeps stamps_later=later",
    {"share": SAME_TOPIC},
    "--topic {0.first_quoted}",
)
"""Of a topic whose sweeps are those of another one."""

_SITS = (
    "{0.child} sits at x {0.x:.2f} +- {0.sd[0]:.2f} m, y {0.y:.2f} +- {0.sd[1]:.2f} m, yaw {0.yaw_degrees:.1f} +- "
    "{0.sd_degrees:.1f} degrees in {0.parent}; "
)
_ASKEW = {"distance": MIN_OFF, "yaw": round(MIN_ASKEW, 4), "deviations": DEVIATIONS}
_SECTORS = "{name}: beams from {0.places} degrees "

MIRROR = Rule(
    "mirror",
    "error",
    lambda s: s.related < MIRRORED,
    "{name} turns the other way than its poses ({0.turns_shown}): its beams run the wrong way round, or the sensor hangs "
    "head down and tf does not say so",
    "correlation turns",
    {"correlation": MIRRORED},
    mend="order",
)
MOUNT = Rule("mount", "warning", lambda s: s.differs, _SITS + "{0.says} {0.told_shown}{0.cause}", "*evidence", _ASKEW)
MOUNT_UNKNOWN = Rule(
    "mount",
    "hint",
    lambda s: s.turned < MIN_TURN,
    "mount of {0.child}: cannot be told: the poses turn by {0.turned_degrees:.0f} degrees, and "
    f"{math.degrees(MIN_TURN):.0f} are needed",
    "turned",
    {"turned": round(MIN_TURN, 3)},
)
STAMP = Rule(
    "stamp",
    "warning",
    lambda s: s.beam != "first" and DEVIATIONS * s.unsure <= 0.5 and s.off <= max(STAMP_OFF, 2.0 * s.unsure),
    "{name}: header stamps are those of the {0.beam} beam, not of the first one: the first is sent {0.early:.3f} +- "
    "{0.deviation:.3f} s earlier, and a sweep takes {0.seconds:.3f} s",
    "delay sd_delay duration",
    {"share": STAMP_OFF, "deviations": DEVIATIONS},
    "--pose-delay {0.mends:.3f}",
    mend="stamps",
)
LASERS = Rule("lasers", "warning", lambda s: s.is_told, _SITS + "tf says {0.told_shown}", "*evidence", _ASKEW)
LASERS_UNTOLD = Rule("lasers", "hint", lambda s: not s.is_told, _SITS + "nothing in the log tells so", "*evidence", _ASKEW)
LASERS_UNKNOWN = Rule("lasers", "hint", lambda s: s.why, "{name} beside {0.first}: cannot be told: {0.why}")
BODY = Rule(
    "body",
    "warning",
    lambda s: s.masks,
    "{name}: {0.beams_shown} at {0.nearest:.2f} to {0.farthest:.2f} m never change: the robot's own body?",
    "beams nearest farthest",
    {"beams": 1},
)
BODY_UNKNOWN = Rule(
    "body",
    "hint",
    lambda s: s.beams,
    "{name}: cannot be told: {0.why} ({0.beams_shown} below {0.reach:g} m)",
    "beams",
    {"beams": 1, "range": "reach"},
)
FLICKER = Rule(
    "flicker",
    "warning",
    lambda s: len(s.sectors),
    _SECTORS + "change between valid and no return in up to {0.worst:.0%} of the steps from sweep to sweep",
    "sectors changes",
    {"changes": FLICKERS},
)
LOST_SECTORS = Rule(
    "flicker",
    "warning",
    lambda s: len(s.sectors) and s.others_share >= OTHERS_VALID and s.turned >= MIN_TURN,
    _SECTORS + "never have a range, though the sensor turned by {0.turned_degrees:.0f} degrees",
    "sectors valid others",
    {"others": OTHERS_VALID},
)


def judge(rules: Iterable[Rule], stats: Any, sensor: Sensor, known: Collection[str] = ()) -> list[Finding]:
    """Return the findings on a sensor by its statistics; `known` are identifiers of those that there are already."""
    findings = []
    ended: set[str] = set()
    for rule in rules:
        if rule.chain in ended or not set(rule.unless).isdisjoint(known) or not rule.holds(stats):
            continue
        ended |= {rule.chain} - {""}
        findings.append(rule.finding(stats, sensor))
    return findings
