"""Logs written once more, as a whole or in parts, by the writers of their libraries."""
