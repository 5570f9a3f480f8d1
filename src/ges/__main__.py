"""The command line as ``python -m ges``."""

from ges.cli import main

if __name__ == "__main__":
    main()
