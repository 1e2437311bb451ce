"""Logs, formalism and tables meet here and nowhere else: files in, files out."""
