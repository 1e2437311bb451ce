"""Logs and tables in object stores, against real servers."""
