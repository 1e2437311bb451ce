"""MCAP files and streams."""
