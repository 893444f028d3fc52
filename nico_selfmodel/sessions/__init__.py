"""What the commands learn, record, simulate and live run."""
