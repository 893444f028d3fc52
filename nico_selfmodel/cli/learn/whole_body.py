"""The part of `nico-selfmodel learn` in which the head turns: `--head`, `--arms`."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.option_groups import Output
from nico_selfmodel.cli.result_files import judge_and_write

if TYPE_CHECKING:
    from nico_selfmodel.sessions.whole_scenario import WholeScenario
    from nico_selfmodel.systems.simulated.imperfections import Imperfections


def learn_whole_body(
    output: Output,
    world: "Imperfections",
    seed: int,
    arms: Sequence[str],
) -> NoReturn:
    """Let the head look about a room and at the hands, learn all of it, write the result."""
    from nico_selfmodel.estimation.tree.tree_result import body_model
    from nico_selfmodel.sessions.whole_scenario import learn_whole
    from nico_selfmodel.viz.reports.tree import tree_report

    with printer.progress_bar() as progress:
        scenario = learn_whole(world, seed, arms=arms, stage=progress)
        document = judge_and_write(
            scenario.found,
            body_model(scenario.found),
            partial(tree_report, scenario.found),
            output,
            progress,
            more=_document(scenario),
            recordings={"train": scenario.train, "test": scenario.test},
        )
    more = _told_in_words(document)
    printer.result(scenario.found.name, document, output, more=more)


def _document(scenario: "WholeScenario") -> dict[str, Any]:
    """Return what `result.json` tells of each lens alone and of each hand besides."""
    from nico_selfmodel.estimation.tree.link_errors import held_out_links

    return {
        "lenses": {
            name: {"boards": len(lens.views), "rms_px": lens.rms}
            for name, lens in scenario.lenses.items()
        },
        "hands": {
            name: {
                "n": errors.n,
                "mean_px": errors.mean_px,
                "noise_px": errors.noise_px,
                "mechanics_px": scenario.mechanics[name],
                "ratio": errors.mean_px / scenario.mechanics[name],
            }
            for name, errors in held_out_links(scenario.found).items()
        },
    }


def _told_in_words(document: Mapping[str, Any]) -> list[str]:
    lenses = (
        f"{name} learned from {lens['boards']} views of cards to {lens['rms_px']:.2f} px"
        for name, lens in document["lenses"].items()
    )
    hands = (
        f"hand on {name}: {hand['mean_px']:.2f} px held out, {hand['ratio']:.2f} times the "
        f"{hand['mechanics_px']:.2f} px that its mechanics leave"
        for name, hand in document["hands"].items()
    )
    return [*lenses, *hands]
