"""Readers of logs: one file per container behind one protocol (`base.Log`)."""

from lidarcli.logs.registry import open_log

__all__ = ["open_log"]
