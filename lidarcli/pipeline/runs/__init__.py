"""Runs over many logs: the loop over them, worker processes, clusters, and what is left to do in a folder."""
