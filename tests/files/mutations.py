"""Ways in which a file goes wrong, drawn by a seed: bytes, lines, cells, values, pictures."""

import json
import os
import re
import struct
import zlib
from copy import deepcopy
from pathlib import Path

import cv2
import numpy as np
import yaml

NUMBERS = (
    "nan", ".nan", "inf", "-.inf", "1e308", "-1e308", "1e-300", "1e400", "0", "-0", "-1", "-5",
    "1e9", "1e12", "3.5", "10000000000000000000000", "1" + "0" * 400, "0x7f", "1_000", "1:30",
    "1e-3", "2147483648", "1,5", "٣",
)  # fmt: skip
"""What may stand in the place of a number."""
TEXTS = (
    "", "''", " ", "null", "~", "true", "no", "[1, 2]", "{a: 1}", "[]", "{}", "é" * 130, "x" * 300,
    "日本語", "\x1b[31mred\x1b[0m", "a\tb", "a\x00b", "../../up", "=cmd|' /C calc'!A0", "\u202eabc",
    "\ud800", "*x", "&x y", "!!python/object:os.system x", "!!binary aGk=", "2024-01-01",
    "2024-99-99", "<<", "%d", "{0}", "a,b", '"', "'", "hand", "elbow", "counts", "mm", "/dev/zero",
    "a" * 100_000, "[bold]x[/]", "#", "- -", "|", ">", "? x", "@", "`", "NaN.", "İ",
)  # fmt: skip
"""What may stand in the place of a word."""
_VALUES = (
    None, True, False, [], {}, [1, 2], {"a": 1}, "", "x", "hand", float("nan"), float("inf"),
    -float("inf"), 1e308, -1e308, 1e-300, 0, -1, 10**30, 10**400, [[[[1]]]], [None], "1e3", "-",
    "\x1b[2J", "é" * 130, "日本", 5.5, 2**31, 1e9, ["a", "a"], {"nan": 0.0}, 1e12, -1e-12, 1e24,
)  # fmt: skip
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*")
_AT_ONCE = (1, 1, 1, 2, 3, 10)
"""How many places are spoilt together."""


def spoil(path: Path, rng: np.random.Generator) -> str:
    """Spoil a file in one of all the ways that suit it; return which."""
    content = path.read_bytes()
    is_picture = path.suffix in (".png", ".jpg")
    ways = [_spoil_bytes] * 2 + [_spoil_place]
    if is_picture:
        ways += [_spoil_picture] * 4
    elif path.suffix != ".ply":  # which is bytes
        ways += [_spoil_lines, _spoil_encoding] + [_spoil_tokens] * 4
        ways += [_spoil_cells] * 5 if path.suffix == ".csv" else []
        ways += [_spoil_values] * 6 + [_spoil_nests] if path.suffix in (".yaml", ".json") else []
        ways += [_spoil_elements] * 4 if path.suffix == ".urdf" else []
    way = ways[rng.integers(len(ways))]
    return f"{way.__name__.removeprefix('_spoil_')}: {way(path, content, rng)}"


def _pick(rng, choices):
    return choices[rng.integers(len(choices))]


def _span(rng, length: int) -> tuple[int, int]:
    start = int(rng.integers(length)) if length else 0
    return start, start + int(rng.geometric(0.05))


def _spoil_bytes(path: Path, content: bytes, rng) -> str:
    way = _pick(rng, ("flip", "flip", "cut", "drop", "double", "insert", "NUL", "empty", "swell"))
    start, end = _span(rng, len(content))
    if way == "flip":
        spoilt = bytearray(content)
        for place in rng.integers(len(content), size=_pick(rng, (1, 1, 2, 5, 30))):
            spoilt[place] = rng.integers(256)
        content = bytes(spoilt)
    elif way == "cut":
        content = content[:start]
    elif way == "drop":
        content = content[:start] + content[end:]
    elif way == "double":
        content = content[:end] + content[start:]
    elif way == "insert":
        content = content[:start] + rng.bytes(end - start) + content[start:]
    elif way == "NUL":
        content = content[:start] + b"\0" * int(rng.integers(1, 5)) + content[start:]
    elif way == "empty":
        content = _pick(rng, (b"", b"\n", b" ", b"\xef\xbb\xbf", b"---\n", b"#\n", b"null\n"))
    else:
        content = content * int(min(50, 2_000_000 // max(len(content), 1)))
    path.write_bytes(content)
    return f"{way} at {start} to {end}"


def _spoil_place(path: Path, content: bytes, rng) -> str:
    """Put what is no file in the place of one."""
    path.unlink()
    way = _pick(rng, ("folder", "pipe", "device", "null", "loop", "dangling", "missing", "full"))
    if way in ("folder", "full"):
        path.mkdir()
        if way == "full":
            (path / path.name).write_bytes(content)
    elif way == "pipe":
        os.mkfifo(path)
    elif way in ("device", "null"):
        path.symlink_to("/dev/zero" if way == "device" else "/dev/null")
    elif way == "loop":
        path.symlink_to(path.name)
    elif way == "dangling":
        path.symlink_to("nothing")
    return way


def _text(content: bytes) -> str:
    return content.decode("utf-8", "surrogateescape")


def _write(path: Path, text: str) -> None:
    path.write_bytes(text.encode("utf-8", "surrogatepass"))


def _spoil_lines(path: Path, content: bytes, rng) -> str:
    lines = _text(content).split("\n")
    way = _pick(rng, ("double", "drop", "swap", "indent", "many", "keep", "join"))
    at, other = rng.integers(len(lines), size=2)
    if way == "double":
        lines.insert(other, lines[at])
    elif way == "drop":
        del lines[at : at + int(rng.geometric(0.4))]
    elif way == "swap":
        lines[at], lines[other] = lines[other], lines[at]
    elif way == "indent":
        lines[at] = _pick(rng, ("  ", "\t", " " * 300)) + lines[at]
    elif way == "many":
        lines[at:at] = [lines[at]] * 5000
    elif way == "keep":
        lines = lines[: at + 1]
    else:
        lines[at : at + 2] = ["".join(lines[at : at + 2])]
    _write(path, "\n".join(lines))
    return f"{way} {at} {other}"


def _spoil_encoding(path: Path, content: bytes, rng) -> str:
    text = content.decode()
    way = _pick(rng, ("utf-16", "utf-32", "utf-8-sig", "latin-1", "CRLF", "CR", "NEL", "tabs"))
    if way == "latin-1":
        words = list(_WORD.finditer(text))
        place = words[rng.integers(len(words))].end() if words else 0
        text = f"{text[:place]}ü{text[place:]}"
    text = {
        "CRLF": text.replace("\n", "\r\n"),
        "CR": text.replace("\n", "\r"),
        "NEL": text.replace("\n", "\x85"),
        "tabs": text.replace(" ", "\t").replace(",", "\t"),
    }.get(way, text)
    path.write_bytes(
        text.encode(way if way in ("utf-16", "utf-32", "utf-8-sig", "latin-1") else "utf-8")
    )
    return way


def _spoil_tokens(path: Path, content: bytes, rng) -> str:
    """Put odd numbers in the place of numbers, odd words in the place of words."""
    text, changes = _text(content), []
    pattern, odd = _pick(rng, ((_NUMBER, NUMBERS), (_NUMBER, NUMBERS), (_WORD, TEXTS)))
    for _ in range(_pick(rng, _AT_ONCE)):
        found = list(pattern.finditer(text))
        if not found:
            break
        match, new = found[rng.integers(len(found))], _pick(rng, odd)
        text = text[: match.start()] + new + text[match.end() :]
        changes.append(f"{match[0][:20]} -> {new[:40]!r}")
    _write(path, text)
    return "; ".join(changes)


def _spoil_cells(path: Path, content: bytes, rng) -> str:
    rows = [line.split(",") for line in content.decode().splitlines()]
    way = _pick(rng, ("cell", "cell", "cell", "column", "rename", "drop", "double", "add", "order"))
    place = max(range(len(rows)), key=lambda k: len(rows[k])) if way == "rename" else 0
    at = int(rng.integers(len(rows[place])))
    if way == "cell":
        for _ in range(_pick(rng, _AT_ONCE)):
            row = rows[rng.integers(len(rows))]
            k = int(rng.integers(len(row)))
            row[k] = _pick(rng, NUMBERS if _NUMBER.fullmatch(row[k]) else TEXTS)
    elif way == "column":
        odd = NUMBERS if _NUMBER.fullmatch((rows[-1][at : at + 1] or [""])[0]) else TEXTS
        new = _pick(rng, odd)
        for row in rows[1:]:
            row[at : at + 1] = [new]
    elif way == "rename":
        rows[place][at] = _pick(rng, TEXTS)
    else:
        order = rng.permutation(len(rows[0]))
        for row in rows:
            if way == "drop":
                del row[at : at + 1]
            elif way == "double":
                row.insert(at, row[at] if at < len(row) else "")
            elif way == "add":
                row.extend(["1"] * int(rng.integers(1, 3)))
            else:
                row[:] = [row[k] if k < len(row) else "" for k in order]
    _write(path, "\n".join(map(",".join, rows)) + "\n")
    return f"{way} {at}"


def _spoil_values(path: Path, content: bytes, rng) -> str:
    """Replace, drop, rename or double values anywhere in a document."""
    document = yaml.load(content, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    changes = []
    for _ in range(_pick(rng, _AT_ONCE)):
        places = list(_places(document))
        if not places:
            break
        holder, key = places[rng.integers(len(places))]
        way = _pick(rng, ("replace",) * 6 + ("drop", "rename", "double", "exchange"))
        changes.append(f"{way} {str(key)[:30]}")
        value = holder[key]
        if way == "drop":
            del holder[key]
        elif way == "rename" and isinstance(holder, dict):
            holder[_pick(rng, ("x", "", "é" * 130, "hand", "\x1b[1m", f"{key} "))] = holder.pop(key)
        elif way == "double" and isinstance(holder, list):
            holder.insert(key, deepcopy(value))
        elif way == "exchange":
            other, where = places[rng.integers(len(places))]
            holder[key] = deepcopy(other.get(where)) if isinstance(other, dict) else value
        else:
            new = deepcopy(_pick(rng, _VALUES))
            if isinstance(value, float) and rng.random() < 0.5:
                new = value * _pick(rng, (-1.0, 0.0, 1e3, 1e-3, 1e6, 1e150, -1e-150, 1.0001))
            holder[key] = new
            changes[-1] += f": {str(new)[:30]!r}"
    if path.suffix == ".json":
        path.write_text(json.dumps(document))
    else:
        _write(path, yaml.safe_dump(document, sort_keys=False, allow_unicode=True))
    return "; ".join(changes)


def _places(document):
    """Yield every holder and key of a document; of long lists a few."""
    if isinstance(document, dict | list):
        keys = list(document) if isinstance(document, dict) else range(len(document))
        for key in list(keys)[:200]:
            yield document, key
            yield from _places(document[key])


def _spoil_nests(path: Path, content: bytes, rng) -> str:
    text = content.decode()
    bomb = "".join(f"x{k}: &x{k} [{', '.join([f'*x{k - 1}'] * 10)}]\n" for k in range(1, 10))
    ways = {
        "deep": "[" * 100_000,
        "deep mappings": "{a: " * 50_000,
        "deep blocks": "".join(" " * k + "a:\n" for k in range(2000)),
        "bomb": "x0: &x0 [1, 2, 3]\n" + bomb + text,
        "merged bomb": "x0: &x0 {a: 1}\n" + text + "\n<<: *x0\n",
        "anchor": "&a " + text,
        "itself": "a: &a [*a]\n" + text,
        "two documents": text + "\n---\n" + text,
        "tag": "!!python/object/apply:os.system ['false']\n",
        "directive": "%YAML 9.9\n---\n" + text,
        "comment": "#" * 1_000_000 + "\n" + text,
        "long key": "x" * 5000 + ": 1\n" + text,
        "list": "- " + text.replace("\n", "\n  "),
        "unclosed": text + "\n'",
        "number": "name: " + "9" * 100_000 + "\n",
    }
    way = _pick(rng, sorted(ways))
    if path.suffix == ".json" and way in ("deep", "deep mappings"):
        ways["deep mappings"] = '{"a": ' * 100_000
    _write(path, ways[way])
    return way


def _spoil_elements(path: Path, content: bytes, rng) -> str:
    text = content.decode()
    tags = list(re.finditer(r"<[^<>]+>", text))
    tag = tags[rng.integers(len(tags))]
    attributes = list(re.finditer(r'[\w]+="[^"]*"', text))
    attribute = attributes[rng.integers(len(attributes))]
    name, _, value = attribute[0].partition("=")
    numbers = " ".join(_pick(rng, NUMBERS) for _ in range(_pick(rng, (1, 3, 3, 4))))
    way = _pick(
        rng, ("drop", "double", "lose", "rename", "value", "value", "value", "word", "bomb", "deep",
              "entity", "cycle", "include", "many")
    )  # fmt: skip
    odd = "".join(c for c in _pick(rng, TEXTS) if c.isprintable() and c not in '<&"')
    start, end = attribute.span()
    if way == "drop":
        text = text[: tag.start()] + text[tag.end() :]
    elif way == "double":
        text = text[: tag.end()] + tag[0] + text[tag.end() :]
    elif way == "lose":
        text = text[:start] + text[end:]
    elif way == "rename":
        text = text[:start] + f"other={value}" + text[end:]
    elif way in ("value", "word"):
        text = text[:start] + f'{name}="{numbers if way == "value" else odd}"' + text[end:]
    elif way == "bomb":
        lines = "".join(f'<!ENTITY x{k} "{f"&x{k - 1};" * 10}">' for k in range(1, 12))
        text = f'<!DOCTYPE robot [<!ENTITY x0 "lol">{lines}]>\n<robot name="&x11;"/>'
    elif way == "deep":
        text = '<robot name="r">' + "<link>" * 100_000
    elif way == "entity":
        text = text.replace(
            '<?xml version="1.0"?>', '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/hostname">]>'
        ).replace('name="small"', 'name="&e;"')
    elif way == "cycle":
        text = text.replace('<parent link="base"/>', '<parent link="palm"/>')
    elif way == "include":
        mesh = '<visual><geometry><mesh filename="/dev/zero"/></geometry></visual></link>'
        text = text.replace('<link name="upper"/>', '<link name="upper">' + mesh)
    else:
        links = "".join(f'<link name="l{k}"/>' for k in range(3000))
        text = text.replace("</robot>", links + "</robot>")
    _write(path, text)
    return f"{way} {tag[0][:40]!r} {attribute[0][:40]!r} {numbers[:60]}"


def _spoil_picture(path: Path, content: bytes, rng) -> str:
    """Write another picture: of odd sizes, depths and contents, or with a header that lies."""
    ways = ("size", "size", "depth", "noise", "plain", "header", "chunk", "large", "other")
    way = _pick(rng, ways)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    width, height = (int(_pick(rng, (1, 2, 15, 16, 17, 40, 333, 3000))) for _ in range(2))
    if way == "size":
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST)
    elif way == "depth":
        gray = image[:, :, 0]
        deep, clear = image.astype(np.uint16) * 257, cv2.merge([*cv2.split(image), gray])
        image = _pick(rng, (gray, deep, clear, 255 - image))
    elif way in ("noise", "plain"):
        h, w = image.shape[:2]
        image = rng.integers(0, 256, (h, w, 3), dtype=np.uint8) if way == "noise" else image * 0
    elif way == "large":
        image = np.tile(image, (1 + 3000 // image.shape[0], 1 + 4000 // image.shape[1], 1))
    elif way == "other":
        content = cv2.imencode(_pick(rng, (".bmp", ".tiff", ".webp", ".ppm")), image)[1].tobytes()
        path.write_bytes(content)
        return way
    elif way == "header":
        sides = [int(_pick(rng, (0, 1, 100, 30_000, 6000, 2**31 - 1, 2**32 - 1))) for _ in "wh"]
        path.write_bytes(_with_size(content, *sides))
        return f"header {sides}"
    elif way == "chunk":
        path.write_bytes(content[:33] + _chunk(b"zTXt", rng.bytes(2000)) + content[33:])
        return way
    suffix = path.suffix if image.dtype == np.uint8 else ".png"
    path.write_bytes(cv2.imencode(suffix, image)[1].tobytes())
    return f"{way} {image.shape} {image.dtype}"


def _with_size(content: bytes, width: int, height: int) -> bytes:
    if content[:4] == b"\x89PNG":
        header = struct.pack(">II", width, height) + content[24:29]
        return content[:8] + _chunk(b"IHDR", header) + content[33:]
    at = content.find(b"\xff\xc0") + 5
    return content[:at] + struct.pack(">HH", height % 2**16, width % 2**16) + content[at + 4 :]


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
