"""First bodies: what a recording tells of joints, markers and cameras before any adjustment."""
