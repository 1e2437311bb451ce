"""Matching (§3): things of interest, and the same things in several runs."""
