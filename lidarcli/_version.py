"""The version, which anybody may import: nothing comes with it."""

__version__ = "0.1.0"
