"""Zones that are watched: the points and agents in them, events, visits and crossings."""
