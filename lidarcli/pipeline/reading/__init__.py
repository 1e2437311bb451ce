"""Reading the sweeps of one log, with their poses, and what is counted on the way."""
