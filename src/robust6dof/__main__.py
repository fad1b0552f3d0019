"""`python -m robust6dof` is the command `robust6dof`."""

import sys

from robust6dof.cli import main

if __name__ == "__main__":
    sys.exit(main())
