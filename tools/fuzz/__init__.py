"""A seeded mutator for every container: whatever is done to a log, reading it ends in tables and a report."""
