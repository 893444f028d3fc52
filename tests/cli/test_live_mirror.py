"""`live --mirror`: the live scene before a mirror, and mirrors that it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.sessions.camera_scenario import RenderedNico
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.watching import Watching
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from ..true_nico import true_model


def model_before(mirrors):
    return replace(true_model(looking_arm("fiducial"), "clean", 3), mirrors=mirrors)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("wall", "no mirror 'wall'; there are glass, far"),
        ("=300,0,0", "needs a name"),
        ("glass=1,2", "expected ID=distance"),
        ("far", "--mirror far=MM,DEG,DEG"),
        pytest.param("glass=3000,0,0", "hardly any pose", marks=pytest.mark.slow),
    ],
)
def test_mirrors_that_cannot_be_shown_are_refused_in_one_line(words, reason, tmp_path, command):
    far = Mirror.from_values([0.3, 0.0, 0.5])
    save_model(model_before({"glass": DEFAULT_MIRROR, "far": far}), tmp_path / "arm.yaml")
    page = tmp_path / "page.html"
    body = ("--imperfections", "clean", "--seed", 3)
    done = command("live", tmp_path / "arm.yaml", *body, "--mirror", words, "--out", page)
    assert done.returncode == 2
    assert reason in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not page.exists()


@pytest.mark.slow
def test_a_body_that_knows_its_mirror_predicts_what_it_sees_in_it():
    nico = RenderedNico(IMPERFECTIONS["clean"], 3, ("fiducial",))
    (view,) = NicoBeforeMirrors(nico, {"glass": DEFAULT_MIRROR}).views.values()
    true = nico.ground_truth.mirror(view.X_BM)
    model = model_before({"glass": true})
    with Watching(model, IMPERFECTIONS["clean"], 3, mirror=("glass", None)) as watching:
        watching.go_into_view()
        shown = watching.show()
        assert np.isfinite(shown[:2]).all()
        errors = np.array(watching.visit_random_poses(2))
    assert errors.shape == (2, 4)
    assert np.isfinite(errors[:, 2:]).any()
    assert np.nanmax(errors[:, 2:]) < 1.0
