"""A window to click a colour in, with the pixels that it would match shown live."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.vision.color.color_blob import color_mask, find_color_blob
from nico_selfmodel.vision.color.color_model import ColorModel
from nico_selfmodel.vision.images.image_array import turned_colors
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.plot_style import style

_DIMMED = 0.25  # brightness of what does not match
_HELP = "click on the colour   ·   backspace takes a click back   ·   enter, or closing, is done"


class ColorPicker:
    """What the window shows: the photograph with the clicks, and beside it what they match."""

    def __init__(self, image: NDArray, figure: Figure, radius: float = 3.0) -> None:
        """Fill a figure.

        Args:
            image: BGR, 8 bits. Shape (h, w, 3).
            figure: An empty figure.
            radius: Of the disk of pixels around each click that counts [px].
        """
        self._image, self._figure, self._radius = image, figure, radius
        self.clicks: list[tuple[float, float]] = []
        self.model: ColorModel | None = None
        rgb = turned_colors(np.ascontiguousarray(image))
        figure.set_layout_engine("constrained")
        self._photo, self._matched = figure.subplots(1, 2, sharex=True, sharey=True)
        for axes, title in ((self._photo, "photograph"), (self._matched, "what matches")):
            axes.set_title(title)
            axes.set_axis_off()
        self._photo.imshow(rgb)
        self._dim = (_DIMMED * rgb).astype(np.uint8)
        self._rgb = rgb
        self._shown = self._matched.imshow(self._dim)
        (self._dots,) = self._photo.plot([], [], "o", color="white", mec="black", ms=7, mew=1.5)
        (self._center,) = self._matched.plot([], [], "+", color="white", ms=16, mew=2)
        self._words = figure.suptitle("", fontsize=10.0, color=palette.INK)
        figure.supxlabel(_HELP, fontsize=9.0, color=palette.MUTED)
        self._learn()

    def connect(self) -> None:
        """Take clicks and keys from the window."""
        self._figure.canvas.mpl_connect("button_press_event", self._clicked)
        self._figure.canvas.mpl_connect("key_press_event", self._key)

    def click(self, u: float, v: float) -> None:
        """Add a pixel and learn again."""
        self.clicks.append((u, v))
        self._learn()

    def undo(self) -> None:
        """Take the last pixel back."""
        if self.clicks:
            self.clicks.pop()
            self._learn()

    @property
    def words(self) -> str:
        """What stands above the pictures."""
        return self._words.get_text()

    def _learn(self) -> None:
        self.model, words, center = None, "no pixel clicked yet", None
        shown = self._dim
        if self.clicks:
            try:
                self.model = ColorModel.from_clicks([self._image], [self.clicks], self._radius)
            except SelfModelError as error:
                words = str(error)
        if self.model:
            shown = np.where(color_mask(self._image, self.model)[..., None], self._rgb, self._dim)
            blob = find_color_blob(self._image, self.model)
            if isinstance(blob, NotSeen):
                words = f"not seen: {blob.reason}"
            else:
                center = blob.center
                words = f"seen at ({center[0]:.1f}, {center[1]:.1f}), {blob.area_px} pixels"
        self._shown.set_data(shown)
        self._dots.set_data(np.array(self.clicks).reshape(-1, 2).T)
        self._center.set_data(*([[center[0]], [center[1]]] if center is not None else [[], []]))
        self._words.set_text(words)
        self._figure.canvas.draw_idle()

    def _clicked(self, event: Any) -> None:
        # While a tool of the window (zoom, pan) is on, clicks are its own.
        toolbar = getattr(self._figure.canvas, "toolbar", None)
        if event.inaxes is not None and event.button == 1 and not getattr(toolbar, "mode", ""):
            self.click(float(event.xdata), float(event.ydata))

    def _key(self, event: Any) -> None:
        if event.key == "backspace":
            self.undo()
        elif event.key == "enter":
            from matplotlib import pyplot

            pyplot.close(self._figure)


def pick_color(image: NDArray, title: str, radius: float = 3.0) -> ColorModel:
    """Open a window to click a colour in, and return when it is closed.

    Args:
        image: BGR, 8 bits. Shape (h, w, 3).
        radius: Of the disk of pixels around each click that counts [px].

    Raises:
        SelfModelError: If no window can be opened, or it was closed without a usable click.
    """
    from matplotlib import pyplot
    from matplotlib.backends import BackendFilter, backend_registry

    no_window = "no window can be opened here: give the pixels with --at u,v"
    with style():
        try:
            figure = pyplot.figure(title, figsize=(12.0, 5.4))
        # Toolkits raise errors of their own where there is no display.
        except Exception as error:
            raise SelfModelError(f"{no_window} ({error})") from error
        if pyplot.get_backend().lower() not in backend_registry.list_builtin(
            BackendFilter.INTERACTIVE
        ):
            pyplot.close(figure)
            raise SelfModelError(no_window)
        picker = ColorPicker(image, figure, radius)
        picker.connect()
        pyplot.show(block=True)
    if picker.model is None:
        raise SelfModelError(f"no colour was picked: {picker.words}")
    return picker.model
