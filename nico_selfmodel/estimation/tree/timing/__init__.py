"""What moved while a body was recorded, and what was seen or read at another moment."""
