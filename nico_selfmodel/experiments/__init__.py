"""The thesis' experiments: set-up, run, and a table beside the published figures."""
