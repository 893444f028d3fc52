"""What only the simulation knows of a Nico, as a self-model; for judging, never for learning."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.body.sensors import MarkerInfo
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.plant import SelfModelPlant
from nico_selfmodel.sessions.body_truth import tracked_body
from nico_selfmodel.sessions.rendered_body import RenderedBody
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.nico_cameras import MOUNTS, NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_instance import NicoInstance


def true_model(arm, world, seed):
    """Return arm and cameras as they really are, in the world of the station."""
    body = NicoInstance.build(arm, IMPERFECTIONS[world], seed, NICO_CAMERAS)
    cameras = dict(zip(("left", "right"), true_rig(arm, body).cameras, strict=True))
    return replace(body.model, cameras=cameras, pixel_sigma=0.2, noise_sigma=1e-4)


def true_rig(arm, body):
    """Return the true cameras in the frame of the arm's base, from a plant of the truth."""
    built = SelfModelPlant.from_urdf(arm, body.model)
    context = built.plant.CreateDefaultContext()
    for joint, value in body.held.items():
        built.plant.GetJointByName(joint, built.instance).set_angle(context, value)
    cameras = []
    for camera, link in zip(body.rig.cameras, MOUNTS, strict=True):
        frame = built.plant.GetFrameByName(link, built.instance)
        X_WF = frame.CalcPoseInWorld(context).GetAsMatrix4()
        cameras.append(camera.at(X_WF @ camera.X_WC))
    return StereoRig(*cameras)


def true_body(world, seed):
    """Return a whole body with the corners of its hands' cards, and its room about it."""
    whole = WholeRecording()
    robot = RenderedBody(world, seed, whole)
    mechanics = robot.ground_truth.mechanics
    hands = [MarkerInfo(name, "hand") for name in whole.tracked if name not in whole.room]
    room = [MarkerInfo(name, "world", tuple(p.tolist())) for name, p in whole.room.items()]
    return known_exactly(mechanics, tracked_body(mechanics.tree, [*hands, *room]))


def known_exactly(mechanics, tree, wrong=0.0):
    """Return a body that knows itself, read in the counts of its encoders, but for their zeros."""
    servos = mechanics.servos
    zeros = np.zeros((len(servos.joints), 3))
    zeros[:, 2] = wrong - servos.offset / servos.gear
    X_PJ = tree.X_PJ @ transform(rotation_from_vector(zeros), np.zeros_like(zeros))
    limits = np.stack([mechanics.lower, mechanics.upper])
    tree = replace(tree, X_PJ=X_PJ, gear=servos.gear)
    return BodyModel("nico", tree, servos.radians_per_unit, limits=limits)
