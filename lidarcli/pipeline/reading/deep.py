"""Findings that align sweeps: mounts, the times and the fit of given poses, the robot's own body, beams that flicker."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np

from lidarcli.display.texts import counted
from lidarcli.errors import OptionError
from lidarcli.logs.base import Log, OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.inputs.masks import mask_text
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.reading.masking import MAX_SENSORS, STOOD_REACH, MaskRules, masking_of
from lidarcli.pipeline.reading.mounts import (
    MIN_BEAMS,
    MIN_STEPS,
    SECTOR,
    Calibrated,
    SensorSamples,
    calibrate,
    lasers_finding,
    mount_finding,
    stamp_finding,
)
from lidarcli.pipeline.reading.needs import NONE, Need, PoseOptions
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.pose.findings import Key
from lidarcli.pose.frames import FrameTree
from lidarcli.sweeps.finding_rules import BODY, BODY_UNKNOWN, FLICKER, FLICKERS, LOST_SECTORS, judge
from lidarcli.sweeps.findings import IDS, Finding, Fix
from lidarcli.sweeps.masks import Mask, Masks, Mount, Sector
from lidarcli.sweeps.types import TURN, Bool


@dataclass(frozen=True, slots=True)
class DeepFindings:
    """Findings of a second look at a log, and how to fix them."""

    findings: tuple[Finding, ...] = ()
    masks: Masks = field(default_factory=Masks)
    """Mask of the robot itself."""
    mounts: tuple[Mount, ...] = ()
    """Mounts that differ from those that the log gives, or that it lacks."""


def deep_findings(
    source: Source, opening: OpenOptions | None = None, read: ReadOptions | None = None, poses: PoseOptions | None = None
) -> DeepFindings:
    """Align sweeps of a log, in bounded memory, and return what they contradict; of several runs the longest is read."""
    poses, read = poses or PoseOptions(), read or ReadOptions()
    with open_source(source, opening) as log:
        choice = TopicChoice(read.topics, log.topics())
        masking, posing = _masking(log, read, poses, choice)
        read = ReadOptions(choice.wanted or None, run=read.run or posing.longest, rules=masking.rules)
        posing = posing.of_run(read.run)
        sources = None if posing.found is None else posing.found.sources
        sensors: dict[Key, SensorSamples] = {}
        for batch in read_batches(log, read, ReadReport(), choice):
            for frame, _, sweeps in batch.by_frame():
                key = batch.topic, frame
                if key not in sensors:
                    if len(sensors) == MAX_SENSORS:
                        continue
                    chain = None if sources is None or poses.source == NONE else sources.chain(frame, batch.topic)
                    sensors[key] = SensorSamples(*key, posing.paths.get(key), chain, poses.delay or 0.0)
                sensors[key].add(sweeps)
        links = [] if sources is None else [one for one in sources.tracks if one.is_link and one.static]
        findings: list[Finding] = []
        mounts: list[Mount] = []
        firsts: dict[str, tuple[SensorSamples, Calibrated | None]] = {}
        frames: set[Key] = set()
        for key in sorted(sensors):
            sensor = sensors[key]
            findings += _body(sensor, masking) + _flickering(sensor)
            world = "" if sensor.chain is None else sensor.chain.world
            # One sensor for each frame of a world, the first of its topics.
            if (world, key[1].lstrip("/")) in frames:
                continue
            frames.add((world, key[1].lstrip("/")))
            if mirrored := sensor.mirrored():
                findings += mirrored
                continue
            # Lasers of several robots are not next to each other.
            world = next(iter(firsts), "") if sensor.chain is None else world
            if world not in firsts:
                calibrated = calibrate(sensor)
                finding, mount = mount_finding(sensor, calibrated)
                firsts[world] = sensor, calibrated
                findings += finding + stamp_finding(sensor, calibrated)
            else:
                finding, mount = lasers_finding(*firsts[world], sensor, FrameTree(links, sensor.topic))
                findings += finding
            mounts += mount
        findings.sort(key=lambda one: (IDS.index(one.id), one.topic, one.frame))
        return DeepFindings(tuple(findings), masking.learned, tuple(mounts))


def _masking(log: Log, read: ReadOptions, poses: PoseOptions, choice: TopicChoice) -> tuple[MaskRules, PoseAttacher]:
    """Learn the mask of the robot itself, where the user gave none; return it and the poses."""
    rules = read.rules
    if rules.masks is None or rules.masks.learn:
        try:
            masking = masking_of(log, replace(rules, masks=Masks(learn=True)), poses, choice.wanted or None)
        except OptionError:
            masking = MaskRules(replace(rules, masks=None))
        if masking.posing is not None:
            return masking, masking.posing
    else:
        masking = masking_of(log, rules, poses, choice.wanted or None)
    return masking, PoseAttacher.of(log, poses, choice, replace(read, rules=masking.rules), need=Need.ALL)


def _body(sensor: SensorSamples, masking: MaskRules) -> list[Finding]:
    """Return the findings on beams that end on the robot itself."""
    masks: list[Mask] = [mask for mask in masking.learned.masks if mask.topic == sensor.topic]
    if not masks:
        beams = masking.unclear.get((sensor.topic, sensor.frame), 0)
        why = "nothing moves" if sensor.was_static else "the sensor moves too little"
        unclear = SimpleNamespace(beams=beams, beams_shown=counted(beams, "beam"), why=why, reach=STOOD_REACH)
        return judge([BODY_UNKNOWN], unclear, sensor.named)
    sectors = [mask.shape for mask in masks if isinstance(mask.shape, Sector)]
    beams = sum(round((one.end - one.begin) / sensor.step) for one in sectors) if sensor.step else 0
    body = SimpleNamespace(
        masks=masks,
        beams=beams,
        beams_shown=counted(beams, "beam"),
        nearest=min(one.nearest for one in sectors),
        farthest=max(one.farthest for one in sectors),
        fix=Fix("mask", mask_text(Masks(tuple(masks)), Masks())),
    )
    return judge([BODY], body, sensor.named)


def _flickering(sensor: SensorSamples) -> list[Finding]:
    """Return the findings on sectors that flicker, and on those that are always lost though the sensor turned."""
    counts = sensor.flicker
    if counts.sweeps <= MIN_STEPS:
        return []
    # Of each two changes of a beam that flickers one is back.
    share = 2.0 * counts.changes / np.maximum(counts.steps, 1.0)
    flickers = (counts.steps >= MIN_STEPS * MIN_BEAMS) & (share > FLICKERS)
    worst = float(share[flickers].max(initial=0.0))
    sees = counts.beams >= MIN_BEAMS * counts.sweeps
    others = (counts.valid / np.maximum(counts.beams, 1.0))[sees & (counts.valid > 0)]
    median = float(np.median(others)) if len(others) else 0.0
    lost = _in_sectors(sees & (counts.valid == 0), others_share=median, others=round(median, 3), valid=0.0)
    lost.turned, lost.turned_degrees = sensor.moves.turned, math.degrees(sensor.moves.turned)
    return judge([FLICKER], _in_sectors(flickers, worst=worst, changes=round(worst, 3)), sensor.named) + judge(
        [LOST_SECTORS], lost, sensor.named
    )


def _in_sectors(chosen: Bool, **more: float) -> SimpleNamespace:
    """Return what the rules of sectors ask: the middles of the chosen ones [deg], also as words."""
    middles = sorted(round(math.degrees(math.remainder(one * SECTOR, TURN))) for one in np.flatnonzero(chosen).tolist())
    half = math.degrees(SECTOR) / 2.0
    places = ", ".join(f"{one - half:.0f} to {one + half:.0f}" for one in middles)
    return SimpleNamespace(sectors=middles, places=places, **more)
