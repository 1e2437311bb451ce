"""Matching (§3): objects of interest, and the same objects in several runs."""
