"""Points, things and paths in zones."""
