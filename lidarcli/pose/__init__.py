"""Poses of the sensor: pose messages of a log, the tree of frames, and the choice of a source."""
