"""Definitions 6 and 7 and §3: what is known of each object: its numbers, vertices and faces, its shape and its box."""
