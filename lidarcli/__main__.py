"""`python -m lidarcli` is `lidarcli`."""

from lidarcli.cli import main

if __name__ == "__main__":
    main()
