"""The outer shape of what stands still before the cameras, seen in mirrors."""
