"""Sweeps of real logs judged by eye: what of them is a thing and what is building (docs/annotating.md)."""
