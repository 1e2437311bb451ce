"""Fig. 7: the map of a run, from sweeps whose poses are known."""
