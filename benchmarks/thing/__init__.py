"""How the trees are grown that tell things from building (`lidarcli/formalism/forest.py`)."""
