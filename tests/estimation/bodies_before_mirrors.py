"""Whole Nicos that know themselves exactly, before mirrors."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.sessions.whole_body import whole_nico


def knowing_body(world, seed, data, pixel_sigma=0.3):
    """The body of a simulated Nico as it was built, but for what it does not expect: sag."""
    nico, tree = whole_nico(world, seed)
    servos = nico.mechanics.servos
    assert servos.joints == tree.joints
    zeros = np.array([rotation_about([0.0, 0.0, 1.0], -z) for z in servos.offset / servos.gear])
    noise = dict.fromkeys(tree.joints, max(world.play / np.sqrt(3.0), 1e-7))
    noise |= dict.fromkeys((sensor.name for sensor in tree.sensors), pixel_sigma)
    return BodyModel(
        f"nico {seed}",
        replace(tree, X_PJ=tree.X_PJ @ transform(zeros, np.zeros(3)), gear=servos.gear),
        np.array([joint.si_per_unit for joint in data.joints]),
        noise=noise,
    )


def deviation(found, mirror, plane):
    """Chi-square of a learned plane against the true one, and the angle between them [rad]."""
    (here,) = [m for m in found.tree.mirrors if m.name == mirror]
    names, covariance = found.covariance.names, found.covariance.matrix
    own = [names.index(name) for name in here.names]
    off = here.values - here.values_of(plane)
    sine = np.linalg.norm(np.cross(here.plane.normal, plane.normal))
    return off @ np.linalg.solve(covariance[np.ix_(own, own)], off), np.arcsin(sine)
