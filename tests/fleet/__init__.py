"""Runs over many logs."""
