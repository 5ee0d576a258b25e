"""`python -m navloom`: the command line."""

from navloom.cli import main

if __name__ == "__main__":
    main()
