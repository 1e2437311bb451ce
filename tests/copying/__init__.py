"""Logs that are written once more."""
