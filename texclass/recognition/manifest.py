"""What a model file says of itself: written as JSON beside the arrays, readable without them."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

SCHEMA = (1, 2)
"""Major and minor version of the format. A minor step adds fields that a reader can do without.

1.0: the first. 1.1: `shortest_s`, and answers to a probe that tell whether code or libraries have changed.
1.2: `axes` and `topic` of the input, and why recordings are held out as they are.
"""
LARGEST = 1e12
"""Of a rate in Hz, or a duration in seconds."""


@dataclass(frozen=True)
class Manifest:
    """The facts of a model.

    Attributes
    ----------
    materials
        Surfaces it knows, sorted.
    pipeline
        name, row, classifier and hash of what was trained.
    features
        Features it computes.
    phases
        What it needs of a recording: "tap", "movement", "friction".
    fs
        Sampling rate of its recordings in Hz.
    unit
        Of their acceleration, as kept.
    input
        How files become such recordings: unit in the file, scale, columns, declared phases, resting level.
    trained_on
        name, hash and number of recordings (and windows) of the dataset.
    accuracy
        mean, low, high (95 %), n_tested, protocol, why it, how: of held-out recordings, the choice included.
    calibration
        method, beta, lapse, expected calibration error on held-out recordings, n_bins.
    unknown
        score, false_alarms, threshold, n of held-out recordings, stretch (of distances, by drift).
    cost
        features_ms and classifier_ms per recording, on the machine that trained it.
    touch_s
        Seconds of movement of one answer; None: whole recordings.
    versions
        Of texclass, Python and libraries.
    shortest_s
        Movement of about the shortest recording trained on, in seconds.
    """

    materials: tuple[str, ...]
    pipeline: Mapping[str, str]
    features: tuple[str, ...]
    phases: tuple[str, ...]
    fs: float
    unit: str
    input: Mapping[str, Any]
    trained_on: Mapping[str, Any]
    accuracy: Mapping[str, Any]
    calibration: Mapping[str, Any]
    unknown: Mapping[str, Any]
    cost: Mapping[str, float]
    touch_s: float | None
    versions: Mapping[str, str]
    shortest_s: float | None = None
    schema: tuple[int, int] = field(default=SCHEMA)

    def to_json(self) -> str:
        """Return it as JSON."""
        return json.dumps(asdict(self), sort_keys=True, indent=1)


def read_manifest(text: bytes | str) -> Manifest:
    """Read a manifest of this or an older minor version.

    Raises
    ------
    ValueError
        If it is newer than this program, of another major version, or not a manifest.
    """
    try:
        stated = json.loads(text)
        major, minor = (int(number) for number in stated["schema"])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise ValueError(f"its manifest cannot be read ({type(error).__name__}: {error})") from error
    if (major, minor) > SCHEMA:
        raise ValueError(f"its format is {major}.{minor}, newer than {_dotted(SCHEMA)}: update texclass")
    if major != SCHEMA[0]:
        raise ValueError(f"its format is {major}.{minor}; the rule is {SCHEMA[0]}.x: train it again")
    known = {f.name for f in fields(Manifest)}
    if unknown := set(stated) - known - {"digest"}:
        raise ValueError(f"its manifest holds {min(unknown)!r}; the rule is known facts")
    try:
        facts = {name: _kept(stated[name]) for name in stated if name in known}
        found = Manifest(**facts | {"schema": (major, minor), "fs": float(facts["fs"])})
    except (TypeError, KeyError, ValueError, OverflowError) as error:
        raise ValueError(f"its manifest lacks a fact ({error}); the rule is all of them") from error
    if odd := [name for name, holds in _KINDS.items() if not holds(getattr(found, name))]:
        raise ValueError(
            f"its manifest holds {getattr(found, odd[0])!r:.80} as {odd[0]}; the rule is its kind"
        )
    return found


def _are_texts(value: Any) -> bool:
    return isinstance(value, tuple) and all(isinstance(one, str) for one in value)


def _is_positive(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= LARGEST


def _is_map(value: Any) -> bool:
    return isinstance(value, dict)


_KINDS: Mapping[str, Callable[[Any], bool]] = {
    **dict.fromkeys(("materials", "features", "phases"), _are_texts),
    **dict.fromkeys(("pipeline", "input", "trained_on", "accuracy", "calibration", "unknown"), _is_map),
    **dict.fromkeys(("cost", "versions"), _is_map),
    **dict.fromkeys(("touch_s", "shortest_s"), lambda value: value is None or _is_positive(value)),
    "fs": _is_positive,
    "unit": lambda value: isinstance(value, str),
}
"""Field -> whether a value is of its kind."""


def _kept(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _dotted(version: tuple[int, int]) -> str:
    return f"{version[0]}.{version[1]}"
