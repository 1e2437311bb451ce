"""What happens over time: which objects of two sweeps are one thing, whether it moves, what it is."""
