"""What only the simulation knows of a Nico, as a self-model; for judging, never for learning."""

from dataclasses import replace

from nico_selfmodel.plant import SelfModelPlant
from nico_selfmodel.systems.nico_cameras import MOUNTS, NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_instance import NicoInstance


def true_model(arm, world, seed):
    """Return arm and cameras as they really are, in the world of the station."""
    body = NicoInstance.build(arm, IMPERFECTIONS[world], seed, NICO_CAMERAS)
    built = SelfModelPlant.from_urdf(arm, body.model)
    context = built.plant.CreateDefaultContext()
    for joint, value in body.held.items():
        built.plant.GetJointByName(joint, built.instance).set_angle(context, value)
    cameras = {}
    for name, camera, link in zip(("left", "right"), body.rig.cameras, MOUNTS, strict=True):
        frame = built.plant.GetFrameByName(link, built.instance)
        X_WF = frame.CalcPoseInWorld(context).GetAsMatrix4()
        cameras[name] = camera.at(X_WF @ camera.X_WC)
    return replace(body.model, cameras=cameras, pixel_sigma=0.2, noise_sigma=1e-4)
