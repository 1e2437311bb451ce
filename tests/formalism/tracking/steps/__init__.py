"""Each step of the tracking against closed forms and slow, obvious references; run them with LIDARCLI_COMPILED=no.

Only the source shows its steps: `test_tracking_steps.py` beside this folder runs it in a process of its own.
"""
