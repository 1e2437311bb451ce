"""Definitions 1 to 3 and 5 on one sweep: its points, their differences, its noise, its segments."""
