"""Seeded cases for everything that reads files: whatever is done to an input, it ends in outputs or in one line."""
