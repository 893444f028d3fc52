"""`python -m nico_selfmodel`: the command line, where the script is not on the path."""

from nico_selfmodel.cli.main import main

if __name__ == "__main__":
    main()
