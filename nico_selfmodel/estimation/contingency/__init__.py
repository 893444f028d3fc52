"""Is it me: whether what moves in the image moves when the own encoders do."""
