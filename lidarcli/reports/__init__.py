"""From tables to words, pictures and verdicts: figures of a run, checks, comparison, documents, pictures."""
