"""ARIA logs: the .2d files that robots of MobileRobots (Pioneer and others) write for the making of maps."""
