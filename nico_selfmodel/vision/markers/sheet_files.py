"""Pages of black cells, lines and words as SVG, PDF and PNG files of exact size."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import cv2
import numpy as np

from nico_selfmodel.files.whole import write_bytes_whole

_THIN = 0.2  # width of lines [mm]
_DASH = 1.2  # [mm]
_GREY = 140  # of cut lines, 0 black to 255 white
_POINTS = 72.0 / 25.4  # per mm
_MM_PER_INCH = 25.4


@dataclass(frozen=True)
class Cells:
    """Black cells in a square."""

    left: float
    """[mm]."""
    top: float
    """[mm]."""
    size: float
    """Side of the square [mm]."""
    black: tuple[tuple[int, int, int], ...]
    """Runs of black cells: row, first column, number of cells. The first row is all black."""

    @property
    def rectangles(self) -> list[tuple[float, float, float, float]]:
        """Left, top, width and height of the runs [mm]."""
        side = self.size / self.black[0][2]
        return [
            (self.left + first * side, self.top + row * side, count * side, side)
            for row, first, count in self.black
        ]


@dataclass(frozen=True)
class Blocks:
    """Black rectangles and discs."""

    rectangles: tuple[tuple[float, float, float, float], ...]
    """Left, top, width and height [mm]."""
    discs: tuple[tuple[float, float, float], ...] = ()
    """Centre and radius [mm]."""


@dataclass(frozen=True)
class Line:
    """A thin line: black, or grey and dashed [mm]."""

    x1: float
    y1: float
    x2: float
    y2: float
    dashed: bool = False


@dataclass(frozen=True)
class Text:
    """Words on a base line, in plain ASCII [mm]."""

    x: float
    y: float
    size: float
    text: str
    middle: bool = False
    bold: bool = False


@dataclass(frozen=True)
class Page:
    """What a page holds, in millimetres from its top left corner."""

    width: float
    height: float
    cells: tuple[Cells | Blocks, ...]
    lines: tuple[Line, ...]
    texts: tuple[Text, ...]


def write_pages(path: str | Path, pages: Sequence[Page], dpi: int = 600) -> None:
    """Write pages, whole or not at all.

    Args:
        path: `.pdf`; or `.svg` or `.png`, which hold the first page alone.
        pages: They.
        dpi: Resolution of a PNG, in which edges are rounded to pixels [1/inch].

    Raises:
        ValueError: If the ending is another.
        OSError: If the folder is missing or cannot be written to.
    """
    path = Path(path)
    writers = {".pdf": _pdf_bytes, ".svg": _svg_bytes, ".png": lambda p: _png_bytes(p, dpi)}
    write = writers.get(path.suffix.lower())
    if write is None:
        raise ValueError(f"{path}: a sheet is written as {', '.join(writers)}")
    write_bytes_whole(path, write(pages))


def _svg_bytes(pages: Sequence[Page]) -> bytes:
    """Return the first page as an SVG whose unit is the millimetre."""
    page = pages[0]
    body = []
    for cells in page.cells:
        # One path for all cells: between separate ones, viewers leave hair lines.
        runs = [f"M{_n(x)} {_n(y)}h{_n(w)}v{_n(h)}h{_n(-w)}z" for x, y, w, h in cells.rectangles]
        body.append(f'<path d="{"".join(runs)}"/>')
        for x, y, r in _discs(cells):
            body.append(f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(r)}"/>')
    for dashed in (False, True):
        lines = [line for line in page.lines if line.dashed == dashed]
        drawn = "".join(f"M{_n(a.x1)} {_n(a.y1)}L{_n(a.x2)} {_n(a.y2)}" for a in lines)
        grey = f"rgb({_GREY},{_GREY},{_GREY})"
        look = f'stroke="{grey}" stroke-dasharray="{_DASH}"' if dashed else 'stroke="black"'
        body.append(f'<path d="{drawn}" fill="none" stroke-width="{_THIN}" {look}/>')
    for text in page.texts:
        look = ' text-anchor="middle"' if text.middle else ""
        look += ' font-weight="bold"' if text.bold else ""
        body.append(
            f'<text x="{_n(text.x)}" y="{_n(text.y)}" font-size="{_n(text.size)}"'
            f' xml:space="preserve"{look}>{escape(text.text)}</text>'
        )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_n(page.width)}mm"'
        f' height="{_n(page.height)}mm" viewBox="0 0 {_n(page.width)} {_n(page.height)}"'
        ' font-family="Helvetica, Arial, sans-serif">\n'
        '<rect width="100%" height="100%" fill="white"/>\n' + "\n".join(body) + "\n</svg>\n"
    ).encode()


def _pdf_bytes(pages: Sequence[Page]) -> bytes:
    """Return all pages as a PDF."""
    kids = " ".join(f"{5 + 2 * i} 0 R" for i in range(len(pages)))
    font = "<< /Type /Font /Subtype /Type1 /BaseFont /{} >>"
    objects = [
        "<< /Type /Catalog /Pages 2 0 R >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>",
        font.format("Helvetica"),
        font.format("Helvetica-Bold"),
    ]
    for i, page in enumerate(pages):
        content = _pdf_content(page)
        box = f"[0 0 {_n(page.width * _POINTS)} {_n(page.height * _POINTS)}]"
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents {6 + 2 * i} 0 R"
            " /Resources << /Font << /F1 3 0 R /F2 4 0 R >> >> >>"
        )
        objects.append(f"<< /Length {len(content)} >>\nstream\n{content}\nendstream")
    body, places = b"%PDF-1.4\n", []
    for number, text in enumerate(objects, start=1):
        places.append(len(body))
        body += f"{number} 0 obj\n{text}\nendobj\n".encode("ascii")
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    count = len(objects) + 1
    end = (
        f"xref\n0 {count}\n0000000000 65535 f \n{table}"
        f"trailer\n<< /Size {count} /Root 1 0 R >>\nstartxref\n{len(body)}\n%%EOF\n"
    )
    return body + end.encode("ascii")


def _png_bytes(pages: Sequence[Page], dpi: int) -> bytes:
    """Return the first page as a PNG that says its resolution; edges are rounded to pixels."""
    page, scale = pages[0], dpi / _MM_PER_INCH
    image = np.full((round(page.height * scale), round(page.width * scale)), 255, np.uint8)
    for cells in page.cells:
        for x, y, w, h in cells.rectangles:
            left, right, top, bottom = (round(v * scale) for v in (x, x + w, y, y + h))
            image[top:bottom, left:right] = 0
        for x, y, r in _discs(cells):
            middle = (round((x * scale - 0.5) * 16), round((y * scale - 0.5) * 16))
            cv2.circle(image, middle, round(r * scale * 16), 0, -1, cv2.LINE_AA, 4)
    for line in page.lines:
        for x1, y1, x2, y2 in _dashes(line):
            ends = np.rint(np.array([[x1, y1], [x2, y2]]) * scale).astype(int)
            ink, width = (_GREY if line.dashed else 0), max(1, round(_THIN * scale))
            cv2.line(image, tuple(map(int, ends[0])), tuple(map(int, ends[1])), ink, width)
    for text in page.texts:
        _put_text(image, text, scale)
    _, content = cv2.imencode(".png", image)
    return _with_resolution(content.tobytes(), dpi)


def _n(value: float) -> str:
    """Write a number to a tenth of a micrometre, without needless zeros."""
    return f"{value:.4f}".rstrip("0").rstrip(".")


def _pdf_content(page: Page) -> str:
    """Return drawing commands in millimetres from the top left corner."""
    commands = [f"{_POINTS:.8f} 0 0 {-_POINTS:.8f} 0 {_n(page.height * _POINTS)} cm", f"{_THIN} w"]
    for cells in page.cells:
        runs = [f"{_n(x)} {_n(y)} {_n(w)} {_n(h)} re" for x, y, w, h in cells.rectangles]
        commands += [*runs, "f"] if runs else []
        commands += [_pdf_disc(*disc) for disc in _discs(cells)]
    for dashed in (False, True):
        commands += [f"[{_DASH if dashed else ''}] 0 d", f"{_GREY / 255 if dashed else 0:.3f} G"]
        for line in page.lines:
            if line.dashed == dashed:
                commands.append(f"{_n(line.x1)} {_n(line.y1)} m {_n(line.x2)} {_n(line.y2)} l S")
    for text in page.texts:
        left = text.x - (0.278 * text.size * len(text.text) if text.middle else 0.0)
        words = text.text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
        commands.append(
            f"BT /F{2 if text.bold else 1} {_n(text.size)} Tf 1 0 0 -1 {_n(left)} {_n(text.y)} Tm"
            f" ({words}) Tj ET"
        )
    return "\n".join(commands)


def _discs(cells: Cells | Blocks) -> tuple[tuple[float, float, float], ...]:
    return cells.discs if isinstance(cells, Blocks) else ()


def _pdf_disc(x: float, y: float, r: float) -> str:
    """Return a disc as four cubic curves, round to 0.03 % of its radius."""
    k = 4.0 / 3.0 * (2.0**0.5 - 1.0) * r
    points = [
        *((x + r, y + k), (x + k, y + r), (x, y + r)),
        *((x - k, y + r), (x - r, y + k), (x - r, y)),
        *((x - r, y - k), (x - k, y - r), (x, y - r)),
        *((x + k, y - r), (x + r, y - k), (x + r, y)),
    ]
    words = [f"{_n(a)} {_n(b)}" for a, b in points]
    curves = [f"{' '.join(words[i : i + 3])} c" for i in range(0, 12, 3)]
    return f"{_n(x + r)} {_n(y)} m {' '.join(curves)} f"


def _dashes(line: Line) -> list[tuple[float, float, float, float]]:
    """Return the pieces of a line."""
    if not line.dashed:
        return [(line.x1, line.y1, line.x2, line.y2)]
    start, end = np.array([line.x1, line.y1]), np.array([line.x2, line.y2])
    count = max(1, round(np.linalg.norm(end - start) / (2.0 * _DASH)))
    shares = np.arange(count)[:, None] / count
    first = start + shares * (end - start)
    last = first + 0.5 / count * (end - start)
    return [
        (float(a), float(b), float(c), float(d)) for (a, b), (c, d) in zip(first, last, strict=True)
    ]


def _put_text(image: np.ndarray, text: Text, scale: float) -> None:
    font, thickness = cv2.FONT_HERSHEY_SIMPLEX, max(1, round((0.5 if text.bold else 0.3) * scale))
    (_, unit), _ = cv2.getTextSize("0", font, 1.0, 1)
    size = 0.72 * text.size * scale / max(unit, 1)  # capitals are 0.72 of the height of type
    (width, _), _ = cv2.getTextSize(text.text, font, size, thickness)
    left = text.x * scale - (0.5 * width if text.middle else 0.0)
    where = (round(left), round(text.y * scale))
    cv2.putText(image, text.text, where, font, size, 0, thickness, cv2.LINE_AA)


def _with_resolution(png: bytes, dpi: int) -> bytes:
    """Insert the chunk that says how many pixels a metre has, right behind the header."""
    per_metre = round(dpi / _MM_PER_INCH * 1000.0)
    chunk = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    length = struct.pack(">I", len(chunk) - 4)
    checked = length + chunk + struct.pack(">I", zlib.crc32(chunk))
    header_end = 8 + 4 + 4 + 13 + 4  # signature; length, name, content and check of IHDR
    return png[:header_end] + checked + png[header_end:]
