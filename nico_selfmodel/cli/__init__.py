"""The command line `nico-selfmodel`: one file per command; parses, calls, prints."""
