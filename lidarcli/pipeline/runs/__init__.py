"""Runs over many logs: the loop over them, worker processes and clusters, the plan and the manifest of a folder."""
