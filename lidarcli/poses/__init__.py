"""Where the sensor was at each sweep: pose messages of a log, the tree of frames, and which source to believe."""
