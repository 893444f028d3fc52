"""The mirror test, stage by stage: what was built of it runs, the rest is not there."""
