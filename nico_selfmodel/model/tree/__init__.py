"""A body as a tree of joints, with markers and sensors on its links."""
