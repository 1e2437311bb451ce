"""How well things are followed: simulated logs with known answer, published rules beside it (docs/tracking.md)."""
