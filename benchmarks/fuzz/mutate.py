"""Mutations of an input: bytes, words of a text, values of a tree, members of an archive."""

import copy
import io
import json
import random
import struct
import zipfile
from collections.abc import Callable, Sequence
from typing import Any

Mutator = Callable[[random.Random, bytes], bytes]
Tree = Any

_INTEGERS = (
    0, 1, 2, 7, 16, 127, 128, 255, 256, 32767, 32768, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62,
    2**63 - 1, 2**63, 2**64 - 1,
)  # fmt: skip
_DOUBLES = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e300, 1.7e308, float("inf"), float("-inf"), float("nan"))
WORDS = (
    "", "0", "-1", "-0.0", "1e999", "-1e999", "1e308", "1e-320", "nan", "inf", "-Infinity", "1_0", "0x1F",
    "9" * 30, "9" * 400, "9" * 5000, "true", "None", "null", "é", "\x00", "\ufeff", '"', "'", "\t", ",,",
    "\r", "\u2028", "[" * 40, "{" * 40, "[" * 3000, "(" * 3000, "a." * 600 + "b", "~nobody/x", "../x", "%s%n",
    "١٢",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 3.5, -0.0, 1e308, -1e308, 5e-324, 1e-200, float("inf"), float("-inf"),
    float("nan"), 2**31, 2**53 + 1, 2**63, 10**30, -(10**30), 10**400, 10**5000, 10**6, 10**9, "", "x", "é\n",
    "\x00", "~nobody/x", "1", "nan", "a" * 5000, [], [[]], [1], [None], ["x"], ["x", 1], [1, [2, [3]]],
    [float("inf")] * 2, {}, {"x": 1}, {"": {}}, {"use": 1}, [{}], [[1.0, 2.0], [3.0]], "../../etc/passwd",
    "(" * 200, "(a", "a{9999999999}",
)  # fmt: skip


def of_bytes(rng: random.Random, data: bytes) -> bytes:
    """Flip, set, cut, insert, repeat and exchange bytes, extreme numbers among them."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        data = rng.choice(_BYTE_EDITS)(rng, data)
    return data


def _flip(rng: random.Random, data: bytes) -> bytes:
    spoilt = bytearray(data or b"\0")
    for _ in range(rng.choice((1, 1, 2, 8))):
        spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def _set(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + (piece := _piece(rng)) + data[at + len(piece) :]


def _insert(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + _piece(rng) + data[at:]


def _cut(rng: random.Random, data: bytes) -> bytes:
    first, last = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return data[:first] if rng.random() < 0.4 else data[:first] + data[last:]


def _repeat(rng: random.Random, data: bytes) -> bytes:
    first, last = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return data[:last] + data[first:last] * rng.choice((1, 1, 3)) + data[last:]


def _move(rng: random.Random, data: bytes) -> bytes:
    first, last = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    rest, at = data[:first] + data[last:], rng.randrange(len(data) + 1)
    return rest[:at] + data[first:last] + rest[at:]


def _piece(rng: random.Random) -> bytes:
    order = rng.choice("<>")
    match rng.randrange(4):
        case 0:
            return rng.randbytes(rng.choice((1, 2, 4, 8, 16)))
        case 1:
            return struct.pack(f"{order}d", rng.choice(_DOUBLES))
        case 2:
            return bytes([rng.choice((0, 255, 127, 128, 10, 32))]) * rng.choice((1, 4, 8, 64))
    size = rng.choice((1, 2, 4, 8))
    number = rng.choice(_INTEGERS) % (1 << 8 * size)
    return number.to_bytes(size, "little" if order == "<" else "big")


_BYTE_EDITS = (_flip, _flip, _set, _set, _insert, _cut, _repeat, _move)


def of_text(rng: random.Random, data: bytes) -> bytes:
    """Exchange, drop and repeat words, cells and lines."""
    if rng.random() < 0.2:
        return of_bytes(rng, data)
    text = data.decode("utf-8", "replace")
    lines = text.splitlines(keepends=True) or [""]
    for _ in range(rng.choice((1, 1, 2, 4))):
        i = rng.randrange(len(lines))
        match rng.randrange(6):
            case 0:
                lines.insert(i, lines[rng.randrange(len(lines))])
            case 1 if len(lines) > 1:
                del lines[i]
            case _:
                lines[i] = _changed_line(rng, lines[i])
    return "".join(lines).encode("utf-8", "replace")


def _changed_line(rng: random.Random, line: str) -> str:
    for mark in rng.sample((",", "\t", "=", " ", '"', "."), 6):
        if mark in line:
            cells = line.split(mark)
            at = rng.randrange(len(cells))
            match rng.randrange(4):
                case 0:
                    del cells[at]
                case 1:
                    cells.insert(at, rng.choice(WORDS))
                case _:
                    cells[at] = rng.choice(WORDS)
            return mark.join(cells)
    return rng.choice(WORDS) + ("\n" if line.endswith("\n") else "")


def of_tree(rng: random.Random, tree: Tree) -> Tree:
    """Return a tree of maps and lists with values of other kinds, keys dropped, renamed and added."""
    tree = json.loads(json.dumps(tree))
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        places = list(_places(tree))
        if not places:
            return copy.deepcopy(rng.choice(VALUES))
        inner, key = rng.choice(places)
        match rng.randrange(8):
            case 0:
                del inner[key]
            case 1:
                other, name = rng.choice(places)
                inner[key] = copy.deepcopy(other[name])
            case 2 if isinstance(inner, list):
                inner.append(copy.deepcopy(inner[key]))
            case 2:
                inner[rng.choice(WORDS[:20])] = copy.deepcopy(inner[key])
            case 3 if isinstance(inner[key], int | float):
                inner[key] = rng.choice((-inner[key], inner[key] + 1, inner[key] * 10**6, 2 - inner[key]))
            case 4:
                inner[key] = [copy.deepcopy(inner[key]) for _ in range(rng.choice((1, 2, 50)))]
            case _:
                inner[key] = copy.deepcopy(rng.choice(VALUES))
    return tree


def _places(tree: Tree) -> list[tuple[Any, Any]]:
    keys = list(tree) if isinstance(tree, dict) else list(range(len(tree))) if isinstance(tree, list) else []
    return [place for key in keys for place in ((tree, key), *_places(tree[key]))]


def json_of(tree: Tree) -> bytes:
    """Return JSON (numbers of any length, NaN and infinity included)."""
    return _long(json.dumps, tree).encode("utf-8", "surrogatepass")


def toml_of(tree: Tree) -> bytes:
    """Return a mapping as TOML; unsupported values become strings."""
    if not isinstance(tree, dict):
        return _toml(tree).encode()
    return "".join(f"{_key(key)} = {_toml(value)}\n" for key, value in tree.items()).encode(
        "utf-8", "replace"
    )


def _toml(value: Tree) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(inner) for inner in value) + "]"
    if isinstance(value, bool) or value is None:
        return "true" if value else "false"
    return _long(json.dumps, value) if isinstance(value, str) else _long(repr, value)


def _key(key: str) -> str:
    return json.dumps(key)


def _long(write: Callable[[Any], str], value: Any) -> str:
    import sys

    most = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)
    try:
        return write(value)
    finally:
        sys.set_int_max_str_digits(most)


def trees(read: Callable[[bytes], Tree], write: Callable[[Tree], bytes]) -> Mutator:
    """Return the mutator of a text that is a tree: its values, or its words, or its bytes."""

    def mutate(rng: random.Random, data: bytes) -> bytes:
        if rng.random() < 0.3:
            return of_text(rng, data)
        try:
            return write(of_tree(rng, read(data)))
        except Exception:  # no tree, or one that has become too deep
            return of_text(rng, data)

    return mutate


def members_of(data: bytes) -> dict[str, bytes]:
    """Return the members of a ZIP archive; a ValueError where it is none."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return {info.filename: archive.read(info) for info in archive.infolist()[:100]}
    except Exception as error:
        raise ValueError(str(error)) from error


def archive_of(members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    """Return a whole ZIP archive, its checksums right."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return buffer.getvalue()


def archives(
    change: Callable[[random.Random, dict[str, bytes]], dict[str, bytes]], *, deflate: bool
) -> Mutator:
    """Return a mutator of archives that mutates a member and packs it again, or mutates the bytes."""

    def mutate(rng: random.Random, data: bytes) -> bytes:
        if rng.random() < 0.3:
            return of_bytes(rng, data)
        try:
            members = change(rng, members_of(data))
        except Exception:  # what has been spoilt before need not be changed again
            return of_bytes(rng, data)
        how = zipfile.ZIP_DEFLATED if deflate and rng.random() < 0.3 else zipfile.ZIP_STORED
        return archive_of(members, how)

    return mutate


def either(*mutators: Mutator) -> Mutator:
    """Return a mutator that is one of several, each time another."""
    choice: Sequence[Mutator] = mutators
    return lambda rng, data: rng.choice(choice)(rng, data)
