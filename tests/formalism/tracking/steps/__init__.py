"""Each step of the tracking against closed forms and slow, obvious references; run them with LIDARCLI_COMPILED=no.

Only the source shows its steps: `tests/formalism/test_core_steps.py` runs them in a process of its own.
"""
