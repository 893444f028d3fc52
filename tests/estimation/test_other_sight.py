"""What one camera sees in a mirror is looked for where the other one must see it."""

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.other_sight import nearest_depth, other_sights
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS

RIG = MirrorRig(NICO_CAMERAS, Mirror.from_values([0.05, -0.1, 0.3]))


def beside_the_left_camera(*p_LQ):
    """Return points that are given in the left camera's frame."""
    return apply(RIG.rig.left.X_WC, np.array(p_LQ))


@pytest.mark.parametrize("side", [0, 1])
def test_a_mark_on_the_body_is_looked_for_where_the_other_camera_sees_it(side):
    p_WQ = beside_the_left_camera([0.02, 0.15, -0.05], [-0.03, 0.1, 0.0])
    pixels = RIG.project(p_WQ).reshape(-1, 2, 2)
    depths = apply(RIG.rig.cameras[side].X_CW, reflect(RIG.plane, p_WQ))[:, 2]
    found = other_sights(RIG, side, pixels[:, side], depths)
    assert found[:2] == pytest.approx(pixels[:, 1 - side], abs=1e-6)


@pytest.mark.parametrize("side", [0, 1])
def test_a_spot_on_the_glass_is_looked_for_there(side):
    on_glass = beside_the_left_camera([0.02, 0.03, 0.0])
    on_glass = on_glass - RIG.plane.distance_to(on_glass)[:, None] * RIG.plane.normal
    seen = RIG.rig.cameras[side].project(on_glass)
    found = other_sights(RIG, side, seen, [np.inf])
    assert found == pytest.approx(RIG.rig.cameras[1 - side].project(on_glass), abs=1e-6)


def test_a_spot_beside_the_outline_is_as_far_away_as_the_body_next_to_it():
    depth = np.full((40, 50), np.inf)
    depth[:, :20] = np.linspace(0.7, 0.8, 20)
    assert nearest_depth(depth, 22.4, 15.0) == pytest.approx(0.8)
    assert nearest_depth(depth, 10.0, 15.0) == pytest.approx(depth[0, 10])
    assert np.isnan(nearest_depth(depth, 30.0, 15.0))
    assert np.isnan(nearest_depth(depth, 49.0, 39.0))
