"""The work of the command line as Python functions, which `lidarcli` offers under their names; one file per subject."""
