"""Where the taps and the movement of a recording are."""

from texclass.phases.segmentation import segment

__all__ = ["segment"]
