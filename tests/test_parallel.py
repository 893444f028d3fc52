"""Jobs in other processes: what they return comes back as it was."""

import pickle
from types import MappingProxyType

from nico_selfmodel.experiments.mirror_test.stages import MirrorTest
from nico_selfmodel.experiments.mirror_test.structure import StructureStage
from nico_selfmodel.parallel import Workers

from .learned_ball import ball_body


def test_read_only_mappings_come_back_read_only():
    back = pickle.loads(pickle.dumps(MappingProxyType({"a": 1})))
    assert back == {"a": 1}
    assert isinstance(back, MappingProxyType)


def test_what_robots_learned_comes_back_from_their_process():
    body = ball_body("palm", "fore")
    stage = StructureStage((), 2, (), MappingProxyType({7: body}))
    back = pickle.loads(pickle.dumps(MirrorTest(None, structure=stage)))
    assert back.structure.shapes[7].links.keys() == body.links.keys()


def test_jobs_are_done_in_the_order_of_their_tasks_whoever_does_them():
    tasks = [MappingProxyType({"a": k}) for k in range(3)]
    for count in (1, 2):
        found = Workers(count).map(dict, tasks)
        assert found == [{"a": 0}, {"a": 1}, {"a": 2}]
