"""Tracking: objects of many sweeps become tracks, with their motion, shape and name."""
