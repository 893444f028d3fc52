"""Sensors whose poses a recording knows, as what is fixed or has a prior."""

from dataclasses import replace

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, TURNS
from nico_selfmodel.estimation.tree.tree_setup import Description, Wishes, world_of
from nico_selfmodel.geometry.rotation import rotation_vector_of


def with_known_poses(data: BodyDataset, description: Description | None, wishes: Wishes) -> Wishes:
    """Return wishes that hold, or know, the sensors whose poses a recording knows.

    What the user says of a parameter counts; the sensor that stands for the world stays anyway.

    Args:
        description: The robot as described, where it is.

    Raises:
        DataError: If nothing stands for the world.
    """
    known = [s for s in data.sensors if s.pose_sigma is not None and s.X_LS is not None]
    if not known:
        return wishes
    world, said = world_of(data, description), wishes.pins.names | wishes.priors.keys()
    pinned, priors = dict(wishes.pins.pinned), dict(wishes.priors)
    for sensor in known:
        assert sensor.X_LS is not None
        assert sensor.pose_sigma is not None
        place, turn = sensor.X_LS[:3, 3], rotation_vector_of(sensor.X_LS[:3, :3])
        for parts, values, sigma in zip(
            (SHIFTS, TURNS), (place, turn), sensor.pose_sigma, strict=True
        ):
            for part, value in zip(parts, values.tolist(), strict=True):
                name = f"{sensor.name}.{part}"
                if sensor.name == world or name in said:
                    continue
                if sigma > 0.0:
                    priors[name] = (value, sigma)
                else:
                    pinned[name] = value
    told = frozenset((pinned.keys() | priors.keys()) - said)
    return Wishes(replace(wishes.pins, pinned=pinned), priors, told)
