"""Looks at one's own pictures as a folder: a drawing of each, and what surprised as a table."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.files.whole import folder_written_whole
from nico_selfmodel.sessions.looks.expecting import MirrorLook
from nico_selfmodel.sessions.mirrors.own_pictures import OwnLook
from nico_selfmodel.viz.figures.mirror_test.surprise_plot import surprise_plot
from nico_selfmodel.viz.figures.plot_style import image_bytes

FORMAT = "nico-look/1"
RESULT_FILE = "result.json"


def write_looks(folder: str | Path, looks: Sequence[OwnLook], *, force: bool) -> dict[str, Any]:
    """Write looks, whole or not at all.

    Args:
        folder: To make.
        looks: What was seen, expected, and surprised.

    Returns:
        The content of `result.json`.

    Raises:
        FileExistsError: If the folder exists and may not be replaced.
        OSError: If it cannot be written.
    """
    rows = [_row(look) for look in looks]
    document = {
        "format": FORMAT,
        "looks": rows,
        "surprising": sum(len(camera["places"]) for row in rows for camera in row["cameras"]),
    }
    with folder_written_whole(folder, force=force) as new:
        for look, row in zip(looks, rows, strict=True):
            (new / row["picture"]).write_bytes(image_bytes(_drawing(look), "png"))
        text = json.dumps(document, indent=1, allow_nan=False)
        (new / RESULT_FILE).write_text(text + "\n", encoding="utf-8")
    return document


def _row(look: OwnLook) -> dict[str, Any]:
    """Return one pose as plain data."""
    return {
        "sample": look.sample,
        "mirror": look.mirror,
        "picture": f"{look.mirror}_{look.sample:04d}.png",
        "cameras": [_camera(one, links) for one, links in zip(look.pair, look.places, strict=True)],
    }


def _camera(look: MirrorLook, links: Sequence[str]) -> dict[str, Any]:
    chi_square = look.surprise.chi_square
    judged = chi_square[np.isfinite(chi_square)]
    return {
        "camera": look.side,
        "gain": look.surprise.gain,
        "judged_px": len(judged),
        "mean_chi_square": float(np.mean(judged)),
        "places": [
            {"u": b.u, "v": b.v, "area_px": b.area, "chi_square": b.chi_square, "link": link}
            for b, link in zip(look.blobs, links, strict=True)
        ],
    }


def _drawing(look: OwnLook) -> Any:
    """Draw what was seen, expected, and surprised."""
    looks = {
        one.side: (one.picture, one.expected.picture, one.surprise.chi_square) for one in look.pair
    }
    places = {one.side: [(blob.u, blob.v) for blob in one.blobs] for one in look.pair}
    count = sum(map(len, places.values()))
    found = f"{count} place(s) surprise" if count else "the body looks as expected"
    return surprise_plot(looks, places, f"Sample {look.sample} in mirror {look.mirror}: {found}")
