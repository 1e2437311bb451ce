"""A `LogInfo` as plain values: what `info --format json` prints and `lidarcli.info` returns (docs/info.md)."""

from __future__ import annotations

import math
from typing import Any

from lidarcli.pipeline.inspecting import LogInfo, ScanInfo, Span
from lidarcli.pipeline.reading.pose_finding import PoseInfo


def info_dict(info: LogInfo) -> dict[str, Any]:
    """Plain values by the keys that docs/info.md lists; null stands for what nobody knows."""
    return {
        "path": info.path,
        "format": info.format,
        "compression": info.compression,
        "size": info.size,
        "topics": [
            {"name": topic.name, "type": topic.type, "encoding": topic.encoding, "messages": topic.messages}
            for topic in info.topics
        ],
        "scans": [_scan_json(scan) for scan in info.scans],
        "pose_topics": list(info.pose_topics),
        "pose_sources": [_pose_json(source) for source in info.pose_sources],
        "dropped": [
            {"topic": topic, "cause": cause, "messages": count} for topic, cause, count in info.dropped
        ],
        "notes": list(info.notes),
        "damage": list(info.damage),
    }


def _scan_json(scan: ScanInfo) -> dict[str, Any]:
    clock = scan.clock
    return {
        "topic": scan.topic,
        "frame_id": scan.frame_id,
        "sweeps": scan.sweeps,
        "beams": [int(scan.beams.low), int(scan.beams.high)],
        "field_of_view": _pair(scan.view),
        "angle_min": _pair(scan.angle_min),
        "angle_increment": _pair(scan.increment),
        "closure": list(scan.closure),
        "range_min": _pair(scan.range_min),
        "range_max": _pair(scan.range_max),
        "rate": clock.rate,
        "start_ns": clock.start_ns,
        "end_ns": clock.end_ns,
        "span": clock.span,
        "clock": {
            "monotonic": clock.monotonic,
            "backward_steps": clock.backward,
            "largest_backward_step": clock.largest_backward,
            "repeated_stamps": clock.repeated,
            "zero_stamps": clock.zero_stamps,
            "record_minus_header": clock.offset,
        },
        "beams_by_status": dict(scan.by_status),
        "pose": scan.pose or None,
        "made_of": scan.made_of or None,
    }


def _pose_json(source: PoseInfo) -> dict[str, Any]:
    return {
        "topic": source.topic,
        "type": source.type,
        "poses": source.poses,
        "rate": source.rate,
        "start_ns": source.start_ns,
        "end_ns": source.end_ns,
        "span": source.span,
        "frames": [{"parent": parent, "child": child} for parent, child in source.frames],
    }


def _pair(span: Span) -> list[float | None]:
    """JSON has no infinity and no NaN."""
    return [value if math.isfinite(value) else None for value in (span.low, span.high)]
