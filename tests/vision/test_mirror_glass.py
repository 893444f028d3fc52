"""What a glass looks like to a pinhole camera, and to its reflected twin."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.geometry.homography import apply_homography
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.vision.images.mirror_glass import GlassInView

K = np.array([[400.0, 0.0, 320.0], [0.0, 400.0, 240.0], [0.0, 0.0, 1.0]])
SIZE, GLASS = (640, 480), (0.3, 0.2)
X_CM = transform(rotation_from_vector([0.2, -0.3, 0.05]), [0.03, -0.02, 0.35])


def seen(K, p_CQ):
    u, v, w = K @ p_CQ
    return np.array([u, v]) / w


@pytest.fixture
def glass():
    return GlassInView.of(K, SIZE, X_CM, GLASS)


def test_the_twin_sees_a_point_where_the_camera_sees_its_reflection(glass):
    normal = X_CM[:3, 2]
    plane = Plane(normal, -normal @ X_CM[:3, 3])
    K_V, _ = glass.twin
    X_CV = X_CM @ glass.X_MV
    assert np.linalg.det(X_CV[:3, :3]) == pytest.approx(1.0)
    for p in np.array([[0.0, 0.0, 0.2], [0.05, -0.03, 0.1], [-0.04, 0.02, 0.25]]):
        in_twin = seen(K_V, apply(inverse(X_CV), p))
        to_camera = (
            K @ X_CM[:3, [0, 1, 3]] @ np.linalg.inv(K_V @ inverse(glass.X_MV)[:3, [0, 1, 3]])
        )
        assert_allclose(
            apply_homography(to_camera, in_twin[None])[0], seen(K, reflect(plane, p)), atol=1e-9
        )


def test_the_twins_picture_holds_the_glass_and_the_principal_point(glass):
    K_V, (width, height) = glass.twin
    X_VM = inverse(glass.X_MV)
    points = [seen(K_V, apply(X_VM, np.array([x, y, 0.0]))) for x, y in glass.outline]
    for u, v in [*points, K_V[:2, 2]]:
        assert 0.0 < u < width
        assert 0.0 < v < height
    # Straight out of the glass: all of it is equally deep, and so is the clipping plane.
    assert_allclose([apply(X_VM, [x, y, 0.0])[2] for x, y in glass.outline], glass.distance)


def test_only_what_is_in_the_picture_is_outlined():
    near = transform(np.eye(3), [0.0, 0.0, 0.1])
    glass = GlassInView.of(K, SIZE, near, (2.0, 2.0))
    corners = np.array([seen(K, apply(near, np.array([x, y, 0.0]))) for x, y in glass.outline])
    assert_allclose(
        [corners.min(), corners[:, 0].max(), corners[:, 1].max()], [0, 640, 480], atol=1e-6
    )
    slanted = transform(rotation_from_vector([0.0, 1.4, 0.0]), [0.0, 0.0, 0.05])
    assert np.isfinite(GlassInView.of(K, SIZE, slanted, (2.0, 2.0)).outline).all()


@pytest.mark.parametrize(
    "X",
    [
        transform(np.eye(3), [0.0, 0.0, -0.3]),
        transform(np.eye(3), [2.0, 0.0, 0.3]),
        transform(rotation_from_vector([0.0, np.pi / 2, 0.0]), [0.0, 0.0, 0.3]),
    ],
    ids=["behind the camera", "beside the picture", "edge-on"],
)
def test_what_is_not_in_view_is_none(X):
    assert GlassInView.of(K, SIZE, X, GLASS) is None


def test_a_glass_is_painted_only_where_nothing_is_before_it(glass):
    picture, depth = np.zeros((480, 640, 4), np.uint8), np.full((480, 640), np.inf, np.float32)
    depth[:, :320] = 0.1
    glass.show(picture, depth, (1, 2, 3, 255), None)
    assert not picture[:, :320].any()
    painted = (picture == (1, 2, 3, 255)).all(axis=2)
    assert painted.sum() > 10000
    assert np.isfinite(depth[painted]).all()
    v, u = np.argwhere(painted)[1234]
    p_M = apply(inverse(X_CM), depth[v, u] * np.linalg.inv(K) @ [u + 0.5, v + 0.5, 1.0])
    assert abs(p_M[2]) < 1e-6
