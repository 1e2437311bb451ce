"""Simulated scenes: ray casting, logs in every container, and the truth beside them."""

from lidarcli.simulation.run import Simulated, simulate

__all__ = ["Simulated", "simulate"]
