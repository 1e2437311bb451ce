"""Logs written once more: every message as it was, but for ranges that somebody else replaces."""
