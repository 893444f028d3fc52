"""What a PNG or JPEG says of itself before it is decoded: its size, and whether it is whole.

A file of a few kilobytes may unfold to gigabytes of pixels.
"""

import struct

SMALLEST_SIDE = 16
"""Of a picture that a detector looks at [px]."""
LARGEST_SIDE = 30_000
"""Of a picture [px]; OpenCV's own tools end at 32767."""
MOST_PIXELS = 40_000_000
"""Of a picture."""

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_END_OF_JPEG = b"\xff\xd9"
# Frame headers (SOF) of all kinds of JPEG; between them stand tables with other meanings.
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_ALONE = {0x01, *range(0xD0, 0xD9)}


def check_header(content: bytes) -> tuple[int, int]:
    """Return width and height of a picture that is worth decoding [px].

    Raises:
        ValueError: If it is neither PNG nor JPEG, cut off, empty or too large.
    """
    if content.startswith(_PNG):
        width, height = _size_of_png(content)
    elif content.startswith(_JPEG):
        width, height = _size_of_jpeg(content)
    else:
        raise ValueError("not an image that can be read; save it as PNG or JPEG")
    size = f"{width}x{height} pixels"
    if not width or not height:
        raise ValueError(f"{size}; an image was expected")
    if max(width, height) > LARGEST_SIDE or width * height > MOST_PIXELS:
        raise ValueError(
            f"{size}; at most {MOST_PIXELS // 10**6} megapixels and {LARGEST_SIDE} a side are read:"
            " take a smaller copy"
        )
    return width, height


def _size_of_png(content: bytes) -> tuple[int, int]:
    if len(content) < 24 or content[12:16] != b"IHDR":
        raise ValueError("a PNG without a header; save it anew")
    return struct.unpack(">II", content[16:24])


def _size_of_jpeg(content: bytes) -> tuple[int, int]:
    """Follow the segments to the frame header; what comes after it is looked for its end."""
    place, end = 2, len(content)
    while place + 4 <= end:
        if content[place] != 0xFF:
            break
        kind = content[place + 1]
        if kind == 0xFF or kind in _ALONE:  # padding; markers without a segment
            place += 1 if kind == 0xFF else 2
            continue
        length = int.from_bytes(content[place + 2 : place + 4], "big")
        if kind in _FRAMES and place + 9 <= end:
            height, width = struct.unpack(">HH", content[place + 5 : place + 9])
            if content.find(_END_OF_JPEG, place + length) < 0:
                raise ValueError("a JPEG that is cut off; copy it again")
            return width, height
        place += 2 + max(length, 2)
    raise ValueError("a JPEG without a header; save it anew")
