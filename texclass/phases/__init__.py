"""Where the taps and the movement of a recording are, and what a live stream needs to say so as well."""

from typing import TYPE_CHECKING

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "segmenter": ["AT_REST_M_S2", "Segmenter", "segment"],
        "strikes": ["CLEAR", "HAND_RATE_HZ", "LEAST_PUSH", "Hand"],
        "vibration_track": ["LEAST_SAMPLES", "block_mean"],
    },
)

if TYPE_CHECKING:
    from texclass.phases.segmenter import AT_REST_M_S2 as AT_REST_M_S2
    from texclass.phases.segmenter import Segmenter as Segmenter
    from texclass.phases.segmenter import segment as segment
    from texclass.phases.strikes import CLEAR as CLEAR
    from texclass.phases.strikes import HAND_RATE_HZ as HAND_RATE_HZ
    from texclass.phases.strikes import LEAST_PUSH as LEAST_PUSH
    from texclass.phases.strikes import Hand as Hand
    from texclass.phases.vibration_track import LEAST_SAMPLES as LEAST_SAMPLES
    from texclass.phases.vibration_track import block_mean as block_mean
