"""Zones over the sweeps of a log: where sensors are in the frames of zones, what is in them, and the events of it."""
