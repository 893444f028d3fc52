"""Files: read within limits and with failures in one plain line, written whole or not at all."""
