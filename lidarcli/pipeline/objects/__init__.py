"""Objects of batches of sweeps, their tracks, and the rows of the tables."""
