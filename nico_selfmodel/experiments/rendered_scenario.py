"""What one Nico records for chapter 8 through rendered pictures: by fiducial and by colour."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.experiments.irreducible_error import Limit
from nico_selfmodel.experiments.projected_nico import MARKERS
from nico_selfmodel.experiments.refinement import SEED, Scenario
from nico_selfmodel.sessions.camera_scenario import Counts, RenderedNico, of_marker, watch_hand
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.systems.simulated.imperfections import Imperfections

COUNTS = Counts(boards=13, test_boards=12)
"""The thesis' 13 boards, 60 circle, 100 random and 100 test poses; boards to judge by beside them.
"""


def rendered_scenarios(
    world: Imperfections,
    seed: int,
    trackers: tuple[str, ...],
    stage: Stage | None = None,
    counts: Counts = COUNTS,
) -> dict[str, Scenario]:
    """Let one Nico record what it learns from; all trackers look at the same pictures.

    Args:
        seed: Which robot.
        trackers: How the hand is tracked: `fiducial`, `color`.

    Returns:
        Tracker -> what was recorded, and what ground truth says of it: nothing of colour, since
        no instrument touches the middle of a patch.
    """
    nico = RenderedNico(world, seed, tuple(MARKERS[tracker] for tracker in trackers))
    seen = watch_hand(nico, counts, stage, options=SEED, observed=True)
    held_out = nico.board_views(
        counts.test_boards, 3, progress=telling(stage, "boards kept for judging")
    )
    found = {}
    for tracker in trackers:
        marker = MARKERS[tracker]
        shown, links, limit = of_marker(seen.test, marker), None, None
        if tracker == "color":
            shown = unmeasured(shown)
        else:
            truth = nico.ground_truth
            links = truth.link_lengths(marker)
            limit = Limit.of(tracker, shown, *truth.expected(shown.encoders, marker))
        learned = seen.cameras.self_model("cameras")
        found[tracker] = Scenario(
            of_marker(seen.train, marker), shown, learned, seen.views, held_out, links, limit
        )
    return found


def unmeasured(data: Dataset) -> Dataset:
    """Return data without what was measured from outside."""
    return replace(data, p_WH_measured=np.full_like(data.p_WH_measured, np.nan))
