"""What a user names, and what it means: logs, topics, pairs of tables."""
