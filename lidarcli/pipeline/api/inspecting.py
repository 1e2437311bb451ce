"""`lidarcli.info`: what is in logs."""

from __future__ import annotations

from typing import Any, Unpack

from lidarcli.errors import NoScanError, warn
from lidarcli.logs.options import clouds_hint, no_scan_topic
from lidarcli.pipeline.api.keywords import Inspecting, Paths
from lidarcli.pipeline.api.options import opening_options, pose_options, rules
from lidarcli.pipeline.api.signatures import with_keywords
from lidarcli.pipeline.api.sources import sources_of
from lidarcli.pipeline.detecting import Failed
from lidarcli.pipeline.inspecting import info_dict, inspect_log


@with_keywords
def info(log: Paths, **options: Unpack[Inspecting]) -> list[dict[str, Any]]:
    """What is in a log: topics, sweeps, geometry, clocks, beams, poses, damage. Reads it from end to end.

    Parameters
    ----------
    log : as of `read`

    Returns
    -------
    list of dict
        One for each log, with the keys of `lidarcli info --format json` (docs/info.md).

    Raises
    ------
    UnreadableError, OptionError
        As of `read`. A log without LaserScan is warned of.
    """
    opening, judged, poses = opening_options(options), rules(options), pose_options(options)
    sources = sources_of(log)
    failed = Failed(len(sources))
    told = []
    for source in sources:
        with failed.noted(source):
            found = inspect_log(source, opening, judged, poses)
            for line in found.damage:
                warn(f"{source.path}: {line}")
            if found.exit_code == NoScanError.exit_code:
                warn(f"{source.path}: {no_scan_topic()}{clouds_hint(found.topics)}")
            told.append(info_dict(found))
    failed.conclude()
    return told
