"""What is made of a batch of sweeps: its objects, and the rows of the tables."""
