"""One tree of errors: catching a branch catches what grows on it."""

import pickle

import pytest

from nico_selfmodel import errors

TREE = {
    errors.SelfModelError: Exception,
    errors.ModelError: errors.SelfModelError,
    errors.ImpossibleModelError: errors.ModelError,
    errors.DataError: errors.SelfModelError,
    errors.EstimationError: errors.SelfModelError,
    errors.NotIdentifiableError: errors.EstimationError,
    errors.ContradictedError: errors.EstimationError,
    errors.NotConvergedError: errors.EstimationError,
    errors.RobotError: errors.SelfModelError,
    errors.BusError: errors.RobotError,
    errors.ServoFault: errors.RobotError,
}


@pytest.mark.parametrize(("error", "parent"), TREE.items(), ids=lambda e: e.__name__)
def test_an_error_is_caught_by_its_branch_and_says_only_its_message(error, parent):
    with pytest.raises(parent) as caught:
        raise error("got 3, expected 4", partial=[1.0, 2.0])
    assert str(caught.value) == "got 3, expected 4"
    assert caught.value.partial == [1.0, 2.0]
    assert error("x").partial is None


def test_the_tree_holds_every_error_of_the_module():
    found = {e for e in vars(errors).values() if isinstance(e, type) and issubclass(e, Exception)}
    assert found == set(TREE)


def test_a_lost_robot_is_a_lost_connection():
    assert issubclass(errors.BusError, ConnectionError)
    assert not issubclass(errors.DataError, OSError)


@pytest.mark.parametrize("error", TREE, ids=lambda e: e.__name__)
def test_an_error_keeps_its_partial_result_across_processes(error):
    copy = pickle.loads(pickle.dumps(error("why", partial={"x": 1})))
    assert type(copy) is error
    assert (str(copy), copy.partial) == ("why", {"x": 1})
