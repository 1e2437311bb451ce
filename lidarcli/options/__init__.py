"""Every option, declared once for command line, Python, settings and docs."""
