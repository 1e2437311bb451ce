"""Runs over many logs: which ones, what was done already, and what became of each."""
