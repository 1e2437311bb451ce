"""Messages as the command line of MCAP prints them: JSON, one per line."""
