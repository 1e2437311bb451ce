"""Two checkouts on the same logs: do their tables say the same?"""
