"""From tables to words, pictures and verdicts: figures of a run, one file per format, checks, comparison, drawings."""
