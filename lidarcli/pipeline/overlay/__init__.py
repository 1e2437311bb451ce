"""`overlay`: objects and tracks of a log as a file that viewers play in step with it."""
