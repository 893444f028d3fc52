"""Motors offered to other processes, on localhost."""
