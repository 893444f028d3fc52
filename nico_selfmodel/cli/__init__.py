"""The command line `nico-selfmodel`: one file per command; parses, calls, prints."""

from nico_selfmodel.cli.app import main

__all__ = ["main"]
