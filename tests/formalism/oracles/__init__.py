"""Slow, obvious references of the definitions, from docs/formalism.md: nothing of the package is used in them.

`sweeps.py`, `surfaces.py` and `descriptions.py` are the references. The tests beside them compare with what the core
knows after each step, which only its source shows: run them with LIDARCLI_COMPILED=no.
"""
