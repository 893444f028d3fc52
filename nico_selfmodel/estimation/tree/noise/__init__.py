"""Which noise a recording of a body has: whose own, along which line of sight, shared by what."""
