"""Scenes drawn by chance, for figures and tests: rooms and halls, buildings, and what moves in them."""
