"""The predictor's ports say what the self-model says."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.tracking.self_model_predictor import SelfModelPredictor

ARM = ArmDescription.named("nico")
Q = np.radians([-50.0, 30.0, -20.0, -75.0])


def model(cameras=True, known=True, below=0.3):
    n = len(ARM.joints)
    servos = ServoMap(
        ARM.joints, np.zeros(n), np.ones(n), ("rad",) * n, np.full(n, np.nan), np.ones(n)
    )
    covariance = ParameterCovariance(("right_elbow.theta_offset",), [[1e-4]]) if known else None
    X_WL = np.eye(4)
    X_WL[:3, 3] = ARM.chain.forward(Q) - [0.0, 0.0, below]
    camera = Camera(380.0, 380.0, 320.0, 240.0, (640, 480), k1=-0.2, X_WC=X_WL)
    pair = {"left": camera, "right": replace(camera, cx=310.0)} if cameras else {}
    table = DhTable.from_chain(ARM.chain)
    return SelfModel("arm", table, servos, covariance, cameras=pair)


def output(system, port, readings=Q):
    context = system.CreateDefaultContext()
    system.GetInputPort("encoders").FixValue(context, readings)
    return system.GetOutputPort(port).Eval(context)


def test_the_ports_agree_with_the_self_model():
    known = model()
    predictor = SelfModelPredictor(known)
    prediction = known.predict(Q)
    assert output(predictor, "p_WH") == pytest.approx(prediction.p_WH[0])
    covariance = output(predictor, "covariance").reshape(3, 3)
    assert covariance == pytest.approx(prediction.covariance[0])
    assert np.trace(covariance) > 0.0
    assert output(predictor, "pixels") == pytest.approx(known.rig.project(prediction.p_WH)[0])
    assert output(predictor, "pixels")[0] == pytest.approx(320.0)


def test_a_hand_behind_the_cameras_has_no_pixels():
    assert np.isfinite(output(SelfModelPredictor(model()), "pixels")).all()
    assert np.isnan(output(SelfModelPredictor(model(below=-0.1)), "pixels")).all()


def test_what_is_not_known_is_nan_and_what_is_not_there_has_no_port():
    assert np.isnan(output(SelfModelPredictor(model(known=False)), "covariance")).all()
    assert not SelfModelPredictor(model(cameras=False)).HasOutputPort("pixels")


def test_a_model_without_an_arm_or_marker_is_refused():
    with pytest.raises(ModelError, match="no arm"):
        SelfModelPredictor(SelfModel("cameras"))
    with pytest.raises(ValueError, match="no marker"):
        SelfModelPredictor(model(), "nose")
