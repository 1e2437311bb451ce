"""Every kind of input that `make fuzz` makes; CONTRIBUTING.md tells how to add one."""

from __future__ import annotations

from tools.fuzz.checks import check_targets
from tools.fuzz.cleaning import cleaning_targets
from tools.fuzz.counts import count_targets
from tools.fuzz.databases import database_targets
from tools.fuzz.diffs import diff_targets
from tools.fuzz.geometry import geometry_targets
from tools.fuzz.hostile_logs import hostile_log_targets
from tools.fuzz.links import link_targets
from tools.fuzz.maps import map_targets
from tools.fuzz.masks import mask_targets
from tools.fuzz.metadata import metadata_targets
from tools.fuzz.numbers import number_targets
from tools.fuzz.sample_targets import sample_targets
from tools.fuzz.scenes import scene_targets
from tools.fuzz.settings import settings_targets
from tools.fuzz.tables import table_targets
from tools.fuzz.target import Target
from tools.fuzz.twice import twice_targets
from tools.fuzz.zones import zone_targets

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        *sample_targets(),
        *database_targets(),
        *hostile_log_targets(),
        *count_targets(),
        *geometry_targets(),
        *metadata_targets(),
        *table_targets(),
        *link_targets(),
        *scene_targets(),
        *check_targets(),
        *number_targets(),
        *map_targets(),
        *mask_targets(),
        *diff_targets(),
        *zone_targets(),
        *cleaning_targets(),
        *settings_targets(),
        *twice_targets(),
    )
}
"""Name → target, in the order in which they take turns."""
