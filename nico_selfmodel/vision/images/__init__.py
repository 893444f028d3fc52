"""Pictures: files, cameras, lenses undone."""
