"""Sweeps as arrays, their ranges, masks and zones, and the findings on them: what all rooms share."""
