"""CSV in all its layouts."""
