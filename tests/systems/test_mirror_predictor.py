"""The predictor as a Drake system: encoders in, pixels out."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.errors import ModelError
from nico_selfmodel.experiments.mirror_body import mirror_body
from nico_selfmodel.model import MirrorRig
from nico_selfmodel.systems.mirror_predictor import MirrorPredictor


@pytest.fixture(scope="module")
def body():
    return mirror_body(1)


@pytest.fixture(scope="module")
def model(body):
    mirrors = {name: body.true_mirror(name) for name in ("near", "far")}
    return replace(body.calibrated(), mirrors=mirrors)


def test_every_port_holds_what_the_model_says(body, model):
    system = MirrorPredictor(model)
    context = system.CreateDefaultContext()
    ports = [system.get_output_port(k).get_name() for k in range(system.num_output_ports())]
    assert ports == ["p_WH", "pixels", "reflected.near", "reflected.far"]
    for readings in body.watch("near", 4).encoders:
        system.get_input_port().FixValue(context, readings)
        (p,) = model.predict(readings).p_WH
        assert_allclose(system.GetOutputPort("p_WH").Eval(context), p, atol=1e-12)
        assert_allclose(system.GetOutputPort("pixels").Eval(context), model.rig.project(p))
        for name in model.mirrors:
            shown = system.GetOutputPort(f"reflected.{name}").Eval(context)
            assert_allclose(shown, model.mirror_rig(name).project(p))
            assert isinstance(model.mirror_rig(name), MirrorRig)


def test_what_cannot_be_seen_is_nan(body, model):
    system = MirrorPredictor(model)
    context = system.CreateDefaultContext()
    hidden = body.watch("near", 40).encoders
    behind = [r for r in hidden if np.isnan(model.rig.project(model.predict(r).p_WH)).all()]
    system.get_input_port().FixValue(context, behind[0])
    assert np.isnan(system.GetOutputPort("pixels").Eval(context)).all()
    assert np.isfinite(system.GetOutputPort("reflected.near").Eval(context)).all()


def test_a_body_without_eyes_or_with_another_marker_is_refused(model):
    with pytest.raises(ModelError, match="no pair of cameras"):
        MirrorPredictor(replace(model, cameras={}, mirrors={}))
    with pytest.raises(ValueError, match="no marker 'tool'"):
        MirrorPredictor(model, "tool")
