"""A hand whose marker is located by its corners, on an arm of six joints."""

import numpy as np
import pytest

from nico_selfmodel.sessions.rendered_nico import FIDUCIAL, RenderedNico
from nico_selfmodel.systems.looking import touching_arm
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality


@pytest.mark.slow
def test_corners_are_located_about_the_middle_of_the_marker():
    rough = ImageQuality(supersample=1)
    nico = RenderedNico("clean", 3, (FIDUCIAL,), rough, touching_arm(FIDUCIAL), corners=True)
    data = nico.record("hand", 1, 0, 2)
    assert data.joint_names == touching_arm(FIDUCIAL).joints
    assert set(data.marker) == {FIDUCIAL, *nico.corners}
    seen = np.isfinite(data.pixels).all(axis=1)
    poses = [data.pixels[seen & (data.sample == k)] for k in np.unique(data.sample)]
    whole = [pixels for pixels in poses if len(pixels) == 5]
    assert len(whole) == 2
    for middle, *corners in whole:
        assert np.mean(corners, axis=0) == pytest.approx(middle, abs=1.0)
        assert np.linalg.norm(np.subtract(corners, middle)[:, :2], axis=1).min() > 5.0
