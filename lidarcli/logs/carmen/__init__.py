"""CARMEN logs: the text that the classic data sets of indoor robots come in."""
