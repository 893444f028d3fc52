"""`nico-selfmodel experiment mirror`: chapter 9 of the thesis."""

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish, imperfect, plausible_pixel_sigma
from nico_selfmodel.cli.option_groups import Output


def mirror(
    output: Output,
    robots: options.RobotsOrOne = None,
    pixel_sigma: options.PixelSigma = None,
    joint_noise_deg: options.JointNoise = 0.5,
    rendered: options.Rendered = False,
    imperfections: options.Imperfections = "thesis",
    seed: options.FirstSeed = 0,
) -> None:
    """The hand in three learned mirrors (chapter 9).

    They are learned from 10 to 50 poses. Of 5 robots, or one with --rendered, which takes
    --imperfections; otherwise the noise of the joints and of the tracked marker, 0.3 px, are all
    there is.
    """
    from nico_selfmodel.experiments.mirror import run_mirror
    from nico_selfmodel.experiments.mirror_report import report_of

    output.refuse()
    if rendered and pixel_sigma is not None:
        raise ValueError("--pixel-sigma has no meaning with --rendered: pictures have their noise")
    sigma = plausible_pixel_sigma(pixel_sigma or 0.3)
    noise = 0.5 if joint_noise_deg is None else joint_noise_deg
    if noise > 10.0:
        raise ValueError(f"--joint-noise-deg must be at most 10, got {noise}")
    with printer.progress_bar() as progress:
        if rendered:
            # The renderer is slow to load.
            from nico_selfmodel.experiments.mirror_rendered import run_rendered_mirror

            chosen = imperfect(imperfections, noise)
            results = run_rendered_mirror(chosen, robots or 1, seed, progress=progress)
        else:
            results = run_mirror(robots or 5, sigma, noise, seed, progress)
    finish(report_of(results), output)
