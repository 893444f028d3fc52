"""What moves freely, as boards in hands: its poses, and the cameras and mirrors that saw it."""
