"""Runs that are compared."""
