"""Occupancy grids and point clouds as files."""
