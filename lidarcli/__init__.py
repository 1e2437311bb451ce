"""From a 2D LiDAR log to a table of objects: the public Python API."""

__version__ = "0.1.0"
