"""Readers of logs: one file per container behind one protocol (`base.Log`)."""
