"""What changed in a model, whole turns left out."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.results.model_changes import parameter_changes
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.viz.reports.tables import change_table

from .simulated_bodies import learned


def turned(model, vector, **changes):
    """Return a model whose base is turned as a vector says."""
    X_W0 = model.dh.X_W0.copy()
    X_W0[:3, :3] = rotation_from_vector(vector)
    return replace(model, table=replace(model.dh, X_W0=X_W0), **changes)


@pytest.mark.slow
def test_what_went_round_did_not_change():
    """A base that crosses half a turn, and a zero a whole turn of its joint on."""
    model = learned(0).model
    axis = np.array([0.6, 0.0, 0.8])
    before = turned(model, (np.pi - 0.002) * axis)
    after = turned(before, -(np.pi - 0.003) * axis)
    servos = after.servos
    i = len(servos.joints) - 1
    assert servos.gear[i] > 1.3
    round_once = servos.offset + 2.0 * np.pi * servos.gear * (np.arange(i + 1) == i)
    after = replace(after, servo_map=replace(servos, offset=round_once))
    names = ("M0.rx", "M0.ry", "M0.rz", f"{servos.joints[i]}.theta_offset", "M0.x")
    known = ParameterCovariance(names, np.diag(np.full(5, 1e-6)))
    found = parameter_changes(before, replace(after, covariance=known), names)
    assert found["M0.rx"]["after"] - found["M0.rx"]["before"] == pytest.approx(-3.767, abs=0.01)
    assert found["M0.rx"]["change"] == pytest.approx(0.6 * 0.005, rel=1e-6)
    assert found["M0.rz"]["change"] == pytest.approx(0.8 * 0.005, rel=1e-6)
    assert found[names[3]]["change"] == pytest.approx(0.0, abs=1e-9)
    assert found["M0.x"]["change"] == 0.0
    shown = dict(change_table(found).rows)
    assert shown["M0.rx"][2].text == "+0.172"
    assert shown["M0.rx"][4].text == "3.0"


def test_a_turn_of_the_encoder_is_no_turn_of_a_geared_joint():
    model = learned(0).model
    joint = model.joints[-1]
    offset = model.servos.offset.copy()
    offset[-1] += 2.0 * np.pi
    moved = replace(model, servo_map=replace(model.servos, offset=offset))
    name = f"{joint}.theta_offset"
    change = parameter_changes(model, moved, [name])[name]["change"]
    assert change == pytest.approx(2.0 * np.pi * (1.0 - model.servos.gear[-1]))
    assert abs(change) > 3.0
