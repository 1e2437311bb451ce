"""`diff`: what changed from run to run."""
