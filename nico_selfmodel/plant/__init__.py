"""The self-model as a Drake plant, and the robots it may belong to."""

from typing import TYPE_CHECKING

from nico_selfmodel.lazy import lazy_names

if TYPE_CHECKING:
    from nico_selfmodel.plant.body_plant import BodyPlant
    from nico_selfmodel.plant.description import ArmDescription
    from nico_selfmodel.plant.directives import add_directives
    from nico_selfmodel.plant.export.urdf_export import learned_urdf
    from nico_selfmodel.plant.looking.gaze import GazeSolver
    from nico_selfmodel.plant.self_model_plant import SelfModelPlant

__all__ = [
    "ArmDescription",
    "BodyPlant",
    "GazeSolver",
    "SelfModelPlant",
    "add_directives",
    "learned_urdf",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "body_plant": ("BodyPlant",),
        "description": ("ArmDescription",),
        "directives": ("add_directives",),
        "export.urdf_export": ("learned_urdf",),
        "looking.gaze": ("GazeSolver",),
        "self_model_plant": ("SelfModelPlant",),
    },
)
