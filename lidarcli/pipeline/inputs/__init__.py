"""Inputs by their names: logs, tables, catalogues, and the files that they stand for."""
