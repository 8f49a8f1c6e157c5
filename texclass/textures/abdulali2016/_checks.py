"""What is checked before a texture is made, from a file or otherwise."""

from typing import Any, get_args

import numpy as np

from texclass.textures.abdulali2016.loudness import STEEPEST, Loudness
from texclass.textures.stored import is_number


def check_common(texture: Any) -> None:
    """Raise the ValueError that says which of name, fs, buffer and glide breaks a rule."""
    if not isinstance(texture.name, str):
        raise ValueError(f"name is {texture.name!r}; the rule is text")
    if not is_number(texture.fs) or not (np.isfinite(texture.fs) and texture.fs > 0):
        raise ValueError(f"fs is {texture.fs!r}; the rule is above 0 Hz")
    buffer = getattr(texture, "buffer", 1)
    if not is_number(buffer) or buffer != int(buffer) or buffer < 1:
        raise ValueError(f"buffer is {buffer!r}; the rule is an integer of at least 1")
    if not isinstance(getattr(texture, "glide", True), bool):
        raise ValueError(f"glide is {texture.glide!r}; the rule is true or false")


def check_gap(texture: Any) -> None:
    """Raise the ValueError that says that p + 1 gaps do not fit below pi."""
    largest = np.pi / (texture.order + 1)
    if texture.frame.gap > largest:
        raise ValueError(f"gap is {texture.frame.gap}; the rule is at most pi / (p + 1) = {largest:g}")


def check_loudness(texture: Any) -> None:
    """Make `growth` a pair of floats, or raise the ValueError that says what breaks a rule."""
    if texture.loudness not in get_args(Loudness):
        raise ValueError(f"loudness is {texture.loudness!r}; the rule is one of {get_args(Loudness)}")
    growth = texture.growth
    if not isinstance(growth, list | tuple) or len(growth) != 2 or not all(map(is_number, growth)):
        raise ValueError(f"growth is {growth!r:.80}; the rule is two numbers")
    if not (np.all(np.isfinite(growth)) and min(growth) >= 0 and max(growth) <= STEEPEST):
        raise ValueError(f"growth is {growth}; the rule is 0 to {STEEPEST}")
    object.__setattr__(texture, "growth", tuple(map(float, growth)))
