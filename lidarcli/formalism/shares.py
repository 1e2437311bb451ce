"""How often a thing of each shape looks like each shape in one sweep: what a sweep says, and what a track adds up."""

from __future__ import annotations

SEEN_AS = (
    (0.80, 0.03, 0.01, 0.06, 0.10),
    (0.15, 0.60, 0.01, 0.09, 0.15),
    (0.10, 0.20, 0.40, 0.20, 0.10),
    (0.35, 0.10, 0.03, 0.42, 0.10),
)
"""Of a thing that is prismatic, round, legged or irregular, the share of the sweeps that take it for prismatic, round,
legged, irregular or unknown (docs/accuracy.md, with more room for what is rare: one sweep is no proof)."""
