"""The version, which anybody may import: nothing comes with it."""

__version__ = "0.2.0"
