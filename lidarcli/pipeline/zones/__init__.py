"""`zones`: who or what was in areas and across lines, sweep by sweep."""
