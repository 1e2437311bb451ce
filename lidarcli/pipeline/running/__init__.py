"""Who does the work: threads for one log, processes for several."""
