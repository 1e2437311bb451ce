"""`lidarcli detect`: objects of every sweep as tables, or as a stream on stdout."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from lidarcli.cli.detecting import detection_options, find
from lidarcli.cli.grouped import GroupedCommand
from lidarcli.cli.many_logs import many_logs
from lidarcli.cli.messages import Messages

if TYPE_CHECKING:
    from lidarcli.pipeline.objects.following import TrackOptions


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli detect run.mcap
  lidarcli detect bags/ -o tables --jobs 4 --overwrite
  lidarcli detect run.bag --topic /front_scan --start 10 --end 20 --beams
  lidarcli detect run.bag --topic '/scan*' --start 2026-11-22T10:00:00Z
  lidarcli detect run.mcap --profile paper --range 0.1 12 -o -
  lidarcli detect run.mcap --pose /amcl_pose
  lidarcli detect run.mcap --background empty.background.parquet --removed
  lidarcli detect run.mcap --catalogue things.toml
  lidarcli detect run.mcap --memory --min-thing 0.5 --explain
  lidarcli detect scan.csv --angle-min -135 --fov 270 --degrees
  lidarcli detect bags/ -o tables --dry-run
  lidarcli detect 's3://robots/2026/*/*.mcap' -o s3://robots/tables/ --resume
  lidarcli detect --files-from new.txt --base s3://robots/ --shard 3/8
  lidarcli detect bags/ -o tables --cluster local:4 --partition date
  cat run.mcap | lidarcli detect - -o - --format csv | head""",
)
@many_logs
@detection_options(tables="<log>.objects.parquet and <log>.sweeps.parquet", memory=False)
@click.pass_obj
def detect(say: Messages, /, memory: bool, **asked: Any) -> int:
    """Find the objects of every sweep of every LaserScan topic.

    Writes one row per object to DIR/<log>.objects.parquet and one per sweep to
    DIR/<log>.sweeps.parquet. Sub-folders of LOG are mirrored below DIR.
    """

    def remembering() -> TrackOptions:
        from lidarcli.pipeline.objects.following import TrackOptions

        return TrackOptions(tracks=False)

    return find(say, tracking=remembering if memory else None, **asked)
