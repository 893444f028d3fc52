"""`nico-selfmodel experiment stereo`: chapters 5 and 8 of the thesis."""

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish, plausible_pixel_sigma
from nico_selfmodel.cli.option_groups import Output


def stereo(
    output: Output,
    robots: options.Robots = 5,
    pixel_sigma: options.PixelSigma = 0.2,
    seed: options.FirstSeed = 0,
) -> None:
    """Cameras from few and from many boards (chapters 5 and 8)."""
    from nico_selfmodel.experiments.stereo import report_of, run_stereo

    output.refuse()
    if robots < 2:
        raise ValueError("--robots must be at least 2: their spread is part of the result")
    sigma = plausible_pixel_sigma(pixel_sigma or 0.2)
    with printer.progress_bar() as progress:
        results = run_stereo(robots, sigma, seed, progress)
    finish(report_of(results), output)
