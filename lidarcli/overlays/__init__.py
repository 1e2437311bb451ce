"""Objects and tracks as messages that RViz, Foxglove and Lichtblick draw into a log, and as recordings of rerun."""
