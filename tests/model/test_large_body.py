"""A body whose covariance is large is read as it was written."""

import numpy as np
import pytest

from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel, load_body, save_body
from nico_selfmodel.systems.looking import looking_body


@pytest.mark.slow
def test_a_body_with_hundreds_of_parameters_is_read_as_it_was_written(tmp_path):
    """All 18 joints of a whole Nico with what bends in them have over four hundred."""
    root = np.random.default_rng(0).normal(size=(440, 440))
    tree = looking_body().tree
    joints = len(tree.joints)
    names = tuple(f"{tree.joints[i % joints]}.number_{i}" for i in range(len(root)))
    covariance = ParameterCovariance(names, 1e-6 * root @ root.T)
    body = BodyModel("nico", tree, np.ones(len(tree.joints)), covariance=covariance)
    save_body(body, tmp_path / "body.yaml")
    assert (tmp_path / "body.yaml").stat().st_size > 4_000_000
    found = load_body(tmp_path / "body.yaml").covariance
    assert found is not None
    assert np.array_equal(found.matrix, covariance.matrix)
