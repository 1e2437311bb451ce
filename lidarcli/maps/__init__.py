"""Maps and point clouds as files that other programs read."""
