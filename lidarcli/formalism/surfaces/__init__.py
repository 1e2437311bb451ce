"""Definitions 6 and 7 and §2.2: the faces and corners of segments, walls and what stands before them, objects."""
