"""What learn, record, simulate and watch run."""
