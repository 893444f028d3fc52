"""Pictures of one's own in a mirror: what surprises is found, and other pictures are refused."""

import json
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import load_dataset, save_dataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.sessions.looks.expecting import Expecting, Unknown
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR
from nico_selfmodel.sessions.mirrors.own_pictures import look_at_own_pictures, own_shots
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.images.image_array import bgr_of_rgba
from nico_selfmodel.vision.images.image_file import write_image

from ..cli.one_line import assert_one_clear_line


@cache
def nico():
    return RenderedNico("clean", 2, ("fiducial",))


MIRROR = Mirror.from_values(DEFAULT_MIRROR.values, np.diag(np.square([5e-4, 5e-4, 2e-4])))


@cache
def true_model():
    return nico().ground_truth.model(
        mirrors={"mirror": MIRROR}, robot=nico().arm.source, fit={"mirrors": {"rms_px": 1.0}}
    )


SHARES = (0.5, 0.45)
"""Where between their limits the joints are."""


def poses(mirror="mirror", off=0.0):
    """Return a recording of two poses, its reflections as far aside as told [px]."""
    q = nico().arm.lower + np.outer(SHARES, nico().arm.upper - nico().arm.lower)
    pixels = MirrorRig(true_model().rig, MIRROR).projection(true_model().points(q)).pixels
    mechanics = nico().ground_truth.instance.arm
    return Dataset(
        "own",
        mechanics.joints,
        np.array([1, 2]),
        true_model().servos.to_encoder(q),
        marker=np.full(2, "fiducial"),
        pixels=pixels + off,
        mirror=np.full(2, mirror),
        image_size=true_model().rig.left.image_size,
        cameras={"kept": True},
        extra={"pose": ("1", "2")},
    )


def kept(folder, data, pictures):
    """Write a recording with its pictures, one a pose for each camera."""
    save_dataset(data, folder)
    (folder / "images").mkdir()
    for side, row in pictures.items():
        for k, picture in enumerate(row):
            write_image(folder / "images" / f"{side}{k + 1:04d}.png", picture)
    return folder


def empty():
    """Return pictures of a room in which no mirror is."""
    width, height = true_model().rig.left.image_size
    rng = np.random.default_rng(0)
    return {
        side: [rng.normal(90.0, 2.0, (height, width, 3)).round().astype(np.uint8) for _ in SHARES]
        for side in ("left", "right")
    }


@pytest.mark.slow
def test_a_mark_surprises_where_it_is_and_nothing_else_does(tmp_path, command):
    data, rng, pictures = poses(), np.random.default_rng(3), {}
    with BodyImage(nico().arm, true_model(), supersample=1) as image:
        chest = next(number for number, name in image.links.items() if name == "chest")
        for k, side in enumerate(("left", "right")):
            pictures[side] = []
            for readings in data.encoders:
                seen = image.expect(readings, MIRROR, k)
                picture = 0.93 * bgr_of_rgba(seen.color)
                picture += rng.normal(0.0, 2.0, picture.shape)
                pictures[side].append(np.clip(picture.round(), 0, 255).astype(np.uint8))
        seen = image.expect(data.encoders[1], MIRROR, 0)
        expecting = Expecting(image, true_model().rig, MIRROR, (2.0, 2.0), Unknown())
        judged = np.isfinite(expecting.pixel_sigma(0, seen)) & (seen.labels == chest)
    inside = cv2.distanceTransform(judged.astype(np.uint8), cv2.DIST_L2, 5)
    v, u = np.unravel_index(int(np.argmax(inside)), inside.shape)
    cv2.circle(pictures["left"][1], (int(u), int(v)), 5, (40, 40, 220), -1)
    folder = kept(tmp_path / "own", data, pictures)
    save_model(true_model(), tmp_path / "model.yaml")
    done = command("look", tmp_path / "model.yaml", folder, "--out", tmp_path / "looked")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "looked" / "result.json").read_text())
    places = {
        (row["sample"], one["camera"]): one["places"]
        for row in document["looks"]
        for one in row["cameras"]
    }
    (mark,) = places.pop((2, "left"))
    assert np.hypot(mark["u"] - u, mark["v"] - v) < 1.0
    assert mark["link"] == "chest"
    assert not any(places.values())
    assert (tmp_path / "looked" / "mirror_0002.png").is_file()


@pytest.mark.slow
def test_pictures_in_which_no_mirror_is_are_refused_in_one_line(tmp_path, command):
    folder = kept(tmp_path / "own", poses(), empty())
    save_model(true_model(), tmp_path / "model.yaml")
    done = command("look", tmp_path / "model.yaml", folder, "--out", tmp_path / "looked")
    assert_one_clear_line(done, "no mirror is in view")
    assert not (tmp_path / "looked").exists()


@pytest.mark.slow
def test_a_recording_that_cannot_be_looked_at_says_why(tmp_path):
    folder = kept(tmp_path / "own", poses(), empty())
    data = load_dataset(folder)

    def look(model, data=data, where=folder):
        return look_at_own_pictures(model, data, where, 3)

    with pytest.raises(ModelError, match="has no mirror"):
        look(replace(true_model(), mirrors={}))
    with pytest.raises(ModelError, match="names no robot"):
        look(replace(true_model(), robot={}))
    with pytest.raises(DataError, match="was made in wall; the self-model knows mirror"):
        look(true_model(), poses("wall"))
    with pytest.raises(DataError, match="shows no mirror"):
        look(true_model(), poses(""))
    with pytest.raises(DataError, match="no pictures were kept"):
        look(true_model(), where=tmp_path)
    with pytest.raises(DataError, match=r"the hand is seen 2\d px from where"):
        look(true_model(), poses(off=15.0))


def test_pictures_of_other_cameras_are_refused(tmp_path):
    small = {side: [picture[:240] for picture in row] for side, row in empty().items()}
    folder = kept(tmp_path / "own", poses(), small)
    with pytest.raises(DataError, match=r"640 x 240 pixels.*other cameras took it"):
        own_shots(true_model(), poses(), folder, 3)


@pytest.mark.slow
def test_as_many_poses_of_a_mirror_are_taken_as_asked_for(tmp_path):
    folder = kept(tmp_path / "own", poses(), empty())
    samples, shots = own_shots(true_model(), poses(), folder, 1)
    assert samples == [1]
    assert shots[0].mirror == "mirror"
    assert own_shots(true_model(), poses(), folder, 9)[0] == [1, 2]
