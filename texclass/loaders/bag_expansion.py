"""What is compressed in a bag, expanded within a limit: a small file must not fill the memory."""

import bz2
from collections.abc import Callable

import lz4.frame
import zstandard

MOST_BYTES = 1 << 27
"""A chunk or message that expands to more (128 MB) is refused."""
MOST_EXPANSION = 100
"""A bag that expands to more than so many times its size (or 64 MB, if that is more) is refused."""


def most_expanded(size: int) -> int:
    """Return how many bytes a bag of a size may expand to."""
    return max(MOST_EXPANSION * size, 1 << 26)


class Budget:
    """How much a bag may still expand.

    Parameters
    ----------
    size : int
        Of the file, in bytes.
    """

    def __init__(self, size: int) -> None:
        self._left = most_expanded(size)

    def expand(self, data: bytes, how: str, most: int = MOST_BYTES) -> bytes:
        """Return data decompressed ("", "none", "bz2", "lz4", "zstd").

        Raises
        ------
        ValueError
            If that is impossible, or more than `most` bytes or than the bag may have.
        """
        if how in ("", "none"):
            return data
        if how not in _EXPANDERS:
            raise ValueError(f"compression is {how!r}; the rule is one of none, bz2, lz4, zstd")
        most = min(most, MOST_BYTES, self._left)
        expanded = _EXPANDERS[how](data, most + 1)
        self._left -= len(expanded)
        if len(expanded) > most:
            raise ValueError(f"it expands to more than {most} bytes or {MOST_EXPANSION} times")
        return expanded


_EXPANDERS: dict[str, Callable[[bytes, int], bytes]] = {
    "bz2": lambda data, most: bz2.BZ2Decompressor().decompress(data, most),
    "lz4": lambda data, most: bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, most)),
    "zstd": lambda data, most: zstd_decompressor().stream_reader(data, read_across_frames=True).read(most),
}


def zstd_decompressor() -> zstandard.ZstdDecompressor:
    """Return a decompressor that refuses frames which ask for more than 128 MB to look back on."""
    return zstandard.ZstdDecompressor(max_window_size=1 << 27)
