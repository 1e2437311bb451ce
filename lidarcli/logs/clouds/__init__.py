"""Point clouds as sweeps: the points of a slice of heights, by bearing, and of each bearing the nearest."""
