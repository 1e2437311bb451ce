"""Following things from sweep to sweep: each step by itself, whole logs, and what may not happen."""
