"""What a body knows of itself: chain, servo map, cameras, self-model. Plain numpy."""

from nico_selfmodel.model.cameras.mirror_rig import MirrorRig

__all__ = [
    "MirrorRig",
]
