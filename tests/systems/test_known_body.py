"""A body that learns from its own pictures in a mirror how it stands before it."""

from functools import cache

import numpy as np
import pytest

from nico_selfmodel.geometry.rotation import rotation_about, rotation_vector_of
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.sessions.looks import known_body
from nico_selfmodel.sessions.looks.known_body import STANDING, Shot, know_body
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.images.image_array import bgr_of_rgba


@cache
def nico():
    return RenderedNico("clean", 2, ("fiducial",))


TRUE = DEFAULT_MIRROR
OFF = np.array([1.2e-3, -0.9e-3, 2e-4])
"""How far the mirror is from where the hand told it to be."""


@cache
def readings():
    return (
        nico().ground_truth.model().servos.to_encoder(0.5 * (nico().arm.lower + nico().arm.upper))
    )


@pytest.fixture
def image():
    with BodyImage(nico().arm, nico().ground_truth.model(), supersample=1) as one:
        yield one


@pytest.mark.slow
def test_who_stands_elsewhere_has_its_links_and_joints_there(image):
    before = image.poses(readings())
    (joint,) = image.standing(("neck_yaw",))
    X_WB = transform(rotation_about([0.0, 0.0, 1.0], 0.1), [0.01, 0.02, 0.03])
    image.hold({}, X_WB)
    for link in ("head", "chest", "right_hand"):
        assert image.poses(readings())[link] == pytest.approx(X_WB @ before[link], abs=1e-9)
    (moved,) = image.standing(("neck_yaw",))
    assert moved.axis == pytest.approx(X_WB[:3, :3] @ joint.axis)
    assert "head" in moved.links
    assert "chest" not in moved.links


@pytest.mark.slow
def test_a_turned_neck_turns_the_head_and_not_the_chest(image):
    before = image.poses(readings())
    (joint,) = image.standing(("neck_yaw",))
    image.hold({"neck_yaw": joint.angle + 0.2})
    after = image.poses(readings())
    assert after["chest"] == pytest.approx(before["chest"])
    turned = rotation_about(joint.axis, 0.2) @ before["head"][:3, :3]
    assert after["head"][:3, :3] == pytest.approx(turned, abs=1e-9)


def nose(image, model, mirror):
    """Return where the tip of the nose is expected in the mirror. Shape (4,)."""
    p_W = apply(image.poses(readings())["head"], np.array([[0.0895, 0.0, 0.043]]))
    return MirrorRig(model.rig, mirror).project(p_W[0])


@pytest.mark.slow
def test_neck_and_mirror_are_told_by_the_face_in_the_mirror(image):
    angles = {joint.name: joint.angle for joint in image.standing(STANDING)}
    held = {
        **angles,
        "neck_yaw": angles["neck_yaw"] + 0.02,
        "neck_pitch": angles["neck_pitch"] - 0.01,
    }
    image.hold(held)
    seen = [image.expect(readings(), TRUE, side) for side in range(2)]
    pictures = [np.round(0.93 * bgr_of_rgba(one.color)).astype(np.uint8) for one in seen]
    image.hold(angles)
    guess = Mirror.from_values(TRUE.values + OFF, np.diag(np.square([1e-3, 1e-3, 3e-4])))
    model = nico().ground_truth.model(mirrors={"mirror": guess})
    known = know_body(image, model, [Shot("mirror", readings(), (pictures[0], pictures[1]))])
    found = np.array([known.angles[name] - held[name] for name in ("neck_yaw", "neck_pitch")])
    assert np.abs(found).max() < np.radians(0.25)
    # Mirror and body err together: what matters is where the face is expected in the picture.
    known.pose(image)
    now = nose(image, model, known.mirror("mirror"))
    image.hold(angles)
    before = nose(image, model, guess)
    image.hold(held)
    true = nose(image, model, TRUE)
    assert np.abs(before - true).max() > 0.5
    assert np.abs(now - true).max() < 0.1


@pytest.mark.slow
def test_colours_other_than_described_are_told_and_do_not_move_the_body(image):
    rng, described = np.random.default_rng(0), image.paints
    real = np.clip(described * np.exp(0.1 * rng.standard_normal(described.shape)), 0.01, 1.0)
    before = {link: image.poses(readings())[link] for link in ("head", "chest")}
    image.paint(real, np.zeros(len(real)))
    pictures = []
    for side in range(2):
        seen = 0.93 * bgr_of_rgba(image.expect(readings(), TRUE, side).color)
        pictures.append(np.clip(np.round(seen + rng.normal(0.0, 2.0, seen.shape)), 0, 255))
    image.paint(described, np.zeros(len(real)))
    guess = Mirror.from_values(TRUE.values + OFF, np.diag(np.square([1e-3, 1e-3, 3e-4])))
    model = nico().ground_truth.model(mirrors={"mirror": guess})
    shot = Shot("mirror", readings(), (pictures[0].astype(np.uint8), pictures[1].astype(np.uint8)))
    known = know_body(image, model, [shot])
    paints = known.paints
    seen = paints.sigma < 0.03
    assert seen.sum() >= 5
    off = paints.colors[seen] / real[seen]
    off = np.abs(off / np.median(off) - 1.0).max(axis=1)
    assert off.max() < 0.02
    assert np.median(off) < 0.005
    assert np.abs(described[seen] / real[seen] - 1.0).max() > 0.1
    # Of what no picture shows the description is all that is known.
    assert paints.colors[paints.sigma > 0.149] == pytest.approx(described[paints.sigma > 0.149])
    known.pose(image)
    for link, X_WF in before.items():
        assert image.poses(readings())[link] == pytest.approx(X_WF, abs=6e-3)


@pytest.mark.slow
def test_the_light_is_told_by_the_shades_of_the_body_in_the_mirror(image):
    turn = np.radians([1.5, -2.5, 2.0])
    image.turn_light(turn)
    rng, pictures = np.random.default_rng(0), []
    for side in range(2):
        seen = 0.93 * bgr_of_rgba(image.expect(readings(), TRUE, side).color)
        pictures.append(np.clip(np.round(seen + rng.normal(0.0, 2.0, seen.shape)), 0, 255))
    image.turn_light(np.zeros(3))
    before = {link: image.poses(readings())[link] for link in ("head", "chest")}
    guess = Mirror.from_values(TRUE.values, np.diag(np.square([1e-3, 1e-3, 3e-4])))
    model = nico().ground_truth.model(mirrors={"mirror": guess})
    shot = Shot("mirror", readings(), (pictures[0].astype(np.uint8), pictures[1].astype(np.uint8)))
    known = know_body(image, model, [shot])
    assert np.degrees(known.light) == pytest.approx(np.degrees(turn), abs=0.3)
    # Shades that lie elsewhere are not taken for a body that is turned.
    for link, X_WF in before.items():
        turned = rotation_vector_of(image.poses(readings())[link][:3, :3] @ X_WF[:3, :3].T)
        assert np.degrees(np.linalg.norm(turned)) < 0.3


@pytest.mark.slow
def test_the_search_ends_where_it_would_stay(image, monkeypatch):
    rng, described = np.random.default_rng(0), image.paints
    real = np.clip(described * np.exp(0.1 * rng.standard_normal(described.shape)), 0.01, 1.0)
    turn, model = np.radians([1.5, -2.5, 2.0]), nico().ground_truth.model()
    image.paint(real, np.zeros(len(real)))
    image.turn_light(turn)
    pictures = []
    for side in range(2):
        seen = 0.93 * bgr_of_rgba(image.expect(readings(), TRUE, side).color)
        seen = np.clip(np.round(seen + rng.normal(0.0, 2.0, seen.shape)), 0, 255)
        pictures.append(seen.astype(np.uint8))
    guess = Mirror.from_values(TRUE.values + OFF, np.diag(np.square([1e-3, 1e-3, 3e-4])))
    model = nico().ground_truth.model(mirrors={"mirror": guess})
    shot, steps = Shot("mirror", readings(), (pictures[0], pictures[1])), []

    def learned():
        image.paint(described, np.zeros(len(real)))
        image.turn_light(np.zeros(3))
        image.hold({joint.name: joint.angle for joint in fresh}, np.eye(4))
        return know_body(image, model, [shot], lambda step, of: steps.append((step, of)))

    fresh = image.standing(STANDING)
    known = learned()
    taken = len(steps)
    assert steps[-1] == (known_body._STEPS,) * 2
    assert taken < known_body._STEPS
    monkeypatch.setattr(known_body, "_ARRIVED", 0.0)
    off = (learned().values - known.values) / np.sqrt(np.diag(known.covariance))
    assert len(steps) == taken + known_body._STEPS
    assert np.abs(off[-6:]).max() < 0.3  # the whole body
    assert np.abs(off).max() < 1.0
