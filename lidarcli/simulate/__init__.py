"""Simulated scenes: ray casting, logs in every container, and the truth beside them."""
