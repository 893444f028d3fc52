"""Which places of a surface two cameras see directly and in a mirror."""

import numpy as np
import pytest

from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.solids.solid import Solid
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.plant.link_surfaces import LinkSurface
from nico_selfmodel.systems.stations.seen_surface import SeenSurface

GLASS = Plane(np.array([0.0, 0.0, -1.0]), 0.38)
BALL, RADIUS = np.array([0.3, 0.02, 0.3]), 0.06
"""Aside, so that its flank is seen from before and from behind [m]."""
GRAZING = 0.05
"""Cosine below which lines of sight that graze the ball end a little beside its places."""


def cameras():
    """Return a pair of cameras 60 mm apart, that look at the glass."""
    X_WC = np.eye(4), np.eye(4)
    X_WC[1][0, 3] = 0.06
    left, right = (Camera(200.0, 200.0, 320.0, 240.0, (640, 480), X_WC=X) for X in X_WC)
    return StereoRig(left, right)


def places(directly):
    X_WF, rig = np.eye(4), cameras()
    X_WF[:3, 3] = BALL
    ball = Solid("ellipsoid", (RADIUS,) * 3, np.eye(4))
    surfaces = {"ball": (LinkSurface(None, (ball,), np.ones((1, 3))), X_WF)}
    seen = SeenSurface(surfaces, rig, GLASS)
    rng = np.random.default_rng(3)
    found = [seen.in_mirror(["ball"], 3000, rng, directly=directly).p_FQ for _ in range(8)]
    return rig, apply(X_WF, np.concatenate(found))


def facing(p_WQ, center):
    """Return how far places of the ball face a point, which sees all that do: cosines."""
    ways, normals = center - p_WQ, (p_WQ - BALL) / RADIUS
    return np.sum(ways * normals, axis=1) / np.linalg.norm(ways, axis=1)


@pytest.mark.parametrize("directly", [True, False])
def test_places_in_a_mirror_are_seen_directly_by_both_cameras_or_by_neither(directly):
    rig, p_WQ = places(directly)
    assert len(p_WQ) > 5
    assert np.linalg.norm(p_WQ - BALL, axis=1) == pytest.approx(RADIUS, abs=2e-4)
    for camera in rig.cameras:
        center = camera.X_WC[:3, 3]
        assert (facing(p_WQ, reflect(GLASS, center)) > 0.0).all()
        own = facing(p_WQ, center)
        plain = np.abs(own) > GRAZING
        assert ((own > 0.0) == directly)[plain].all()
        assert plain.mean() > 0.8
