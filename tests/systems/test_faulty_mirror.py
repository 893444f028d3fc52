"""A bent or dirty mirror in the rendered world shows what it would."""

import numpy as np
import pytest

from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.simulated.curved_mirror import curved_reflection
from nico_selfmodel.systems.tracking.reflection_detectors import default_mirror_detectors
from nico_selfmodel.vision.images.not_seen import NotSeen

from .mirror_world import MirrorWorld, plate_pose
from .test_mirror_scene import HAND, MIRROR, RIG, SHARP, card, in_world

FOOT = -MIRROR.distance * MIRROR.normal
"""Where the left camera's perpendicular meets the mirror."""
OFF = np.array([[0.0, 0.0, 0.0], [0.05, -0.09, 0.0], [0.10, 0.03, 0.03], [0.0, -0.05, -0.06]])
WHERE = HAND + OFF


def at_foot():
    """Return the pose of a plate whose middle is the left camera's foot."""
    X_LM = plate_pose(MIRROR)
    X_LM[:3, 3] = FOOT
    return X_LM


def seen(world, p):
    """Return where both cameras find the reflection of a marker at p, nan where they do not."""
    pixels = []
    find = default_mirror_detectors(RIG)["fiducial"]
    for look, image in zip(find, world.look(at_foot(), card(p)), strict=True):
        _, found = look(image, np.full(2, np.nan))
        pixels.append(np.full(2, np.nan) if isinstance(found, NotSeen) else found)
    return np.array(pixels)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [3.0, -6.0, 30.0])
def test_markers_in_a_bent_mirror_are_where_light_takes_the_path_of_stationary_length(radius):
    flat = MirrorWorld(RIG, SHARP, plate=MirrorPlate(width=1.0, height=1.0))
    world = MirrorWorld(RIG, SHARP, plate=MirrorPlate(width=1.0, height=1.0, radius=radius))
    X_LCs = [inverse(RIG.left.X_WC) @ camera.X_WC for camera in RIG.cameras]
    errors, moved = [], []
    for p in WHERE:
        bent = [
            curved_reflection(camera, MIRROR, radius, p[None], X_LC)[0]
            for camera, X_LC in zip(RIG.cameras, X_LCs, strict=True)
        ]
        by_bend = bent - MirrorRig(RIG, MIRROR).project(in_world(p)).reshape(2, 2)
        moved.append(by_bend)
        # What a marker is located wrongly by is the same in both.
        errors.append(seen(world, p) - seen(flat, p) - by_bend)
    found = np.isfinite(errors)
    assert found.sum() >= 4
    assert np.abs(np.array(errors)[found]).max() < 0.3
    # At 3 m a bend is ten pixels, at 30 m still more than the error that is allowed.
    assert np.abs(np.array(moved)[found]).max() > 15.0 / abs(radius)


@pytest.mark.slow
def test_a_very_large_radius_shows_what_a_flat_mirror_does():
    flat = MirrorWorld(RIG, SHARP).look(plate_pose(MIRROR), card(HAND))
    large = MirrorWorld(RIG, SHARP, plate=MirrorPlate(radius=1e7)).look(
        plate_pose(MIRROR), card(HAND)
    )
    for one, other in zip(flat, large, strict=True):
        assert np.abs(one.astype(int) - other).max() <= 1


@pytest.mark.slow
def test_stains_cover_the_glass_and_nothing_else():
    clean, dirty = MirrorWorld(RIG, SHARP), MirrorWorld(RIG, SHARP, plate=MirrorPlate(dirt=0.5))
    X_LM = plate_pose(MIRROR)
    before, after = (world.look(X_LM)[0].astype(int) for world in (clean, dirty))
    edge = np.array([[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, -0.15, 0.0], [0.0, 0.15, 0.0]])
    pixels = RIG.left.project(apply(RIG.left.X_WC @ X_LM, edge))
    changed = np.abs(after - before).max(axis=2) > 3
    v, u = np.nonzero(changed)
    first, last = [u.min(), v.min()], [u.max(), v.max()]
    assert (first > pixels.min(axis=0) - 20.0).all()
    assert (last < pixels.max(axis=0) + 20.0).all()
    assert 0.05 < changed[v.min() : v.max(), u.min() : u.max()].mean() < 0.9


@pytest.mark.slow
def test_stains_stay_where_they_are_on_the_glass_when_it_is_moved():
    world, clean = MirrorWorld(RIG, SHARP, plate=MirrorPlate(dirt=0.5)), MirrorWorld(RIG, SHARP)
    spots = np.random.default_rng(0).uniform([-0.1, -0.08], [0.1, 0.08], (300, 2))
    places = np.column_stack([spots, np.zeros(len(spots))])
    seen = []
    for x in (0.035, 0.075):
        X_LM = plate_pose(MIRROR, x)
        lost = [one.look(X_LM)[0].astype(int) for one in (clean, world)]
        u, v = np.rint(RIG.left.project(apply(RIG.left.X_WC @ X_LM, places))).astype(int).T
        seen.append((lost[0] - lost[1]).sum(axis=2)[v, u])
    assert np.corrcoef(seen)[0, 1] > 0.9
    assert np.std(seen[0]) > 2.0


@pytest.mark.slow
def test_what_a_screen_shows_lies_in_it_whichever_camera_looks():
    world = MirrorWorld(RIG, SHARP, plate=MirrorPlate(width=0.6, height=0.5, live=True))
    found = seen(world, HAND)
    assert np.isfinite(found).all()
    p_W = RIG.triangulate(found.reshape(1, 4)).p_WQ[0]
    assert MIRROR.plane_in(RIG.left.X_WC).distance_to(p_W) == pytest.approx(0.0, abs=2e-3)
    # A mirror shows it as far behind the glass as it is before it.
    mirror = MirrorWorld(RIG, SHARP, plate=MirrorPlate(width=0.6, height=0.5))
    p_W = RIG.triangulate(seen(mirror, HAND).reshape(1, 4)).p_WQ[0]
    assert MIRROR.plane_in(RIG.left.X_WC).distance_to(p_W) < -0.1


@pytest.mark.parametrize(
    ("words", "numbers"),
    [
        ("longer than its diagonal", {"radius": 0.4}),
        ("longer than its diagonal", {"radius": -0.1}),
        ("a share between 0 and 1", {"dirt": 1.5}),
        ("a share between 0 and 1", {"dirt": float("nan")}),
        ("flat and clean", {"live": True, "dirt": 0.1}),
        ("flat and clean", {"live": True, "radius": 3.0}),
    ],
)
def test_glass_that_cannot_be_is_refused(words, numbers):
    with pytest.raises(ValueError, match=words):
        MirrorPlate(**numbers)
