"""Object stores: logs that are read from them, and outputs that are put into them whole."""
