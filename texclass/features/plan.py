"""Assignment of features to channels. This module does not import scikit-learn."""

import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from texclass.features.contract import find_feature
from texclass.features.phase_view import SOUND_CHANNEL, TURN_CHANNELS, pair_prefix, pairs_of, views_of
from texclass.features.sets import FeatureSet, Member, code_hash
from texclass.recording import Phases, Recording, Samples


class Computed(NamedTuple):
    """Features of one recording.

    Attributes
    ----------
    values : ndarray of shape (n_columns,)
        Feature values; NaN where a feature is undefined.
    reasons : tuple of (feature, reason)
        Reasons why features are undefined.
    ms : float
        Computing time in ms.
    phases : Phases
        Phases of the recording.
    """

    values: Samples
    reasons: tuple[tuple[str, str], ...]
    ms: float
    phases: Phases


@dataclass(frozen=True)
class Plan:
    """The feature set of each channel.

    Attributes
    ----------
    parts : tuple of (str, FeatureSet)
        Column prefix and feature set of each channel. The prefix of the combined channels is "".
    channels : tuple of str
        Names of separate channels; empty if the channels are combined.

    Examples
    --------
    >>> from texclass.features.sets import load_feature_set
    >>> features = load_feature_set("strese2015").restricted_to(["variance", "friction"])
    >>> Plan.of(features, ("left", "right")).columns
    ('left/variance', 'right/variance', 'friction')
    """

    parts: tuple[tuple[str, FeatureSet], ...]
    channels: tuple[str, ...] = ()

    @classmethod
    def of(cls, feature_set: FeatureSet, channels: tuple[str, ...] = ()) -> "Plan":
        """Return the plan of a feature set.

        The features are computed on the combined channels, or on each of the given channels and each pair of
        them except the sound. The friction signal is always a separate part.
        """
        if not channels:
            return cls((("", feature_set),))
        per_channel = feature_set.with_phases("tap", "movement", "travel")
        per_pair = feature_set.with_phases("pair")
        pairs = pairs_of(channels) if per_pair.members else ()
        # Without pairs, features of pairs stay in the combined part, which reports why they are undefined.
        combined = feature_set.with_phases(*(() if pairs else ("pair",)), "friction")
        parts = [(f"{name}/", per_channel) for name in channels]
        parts += [(pair_prefix(*pair), per_pair) for pair in pairs]
        return cls((*parts, ("", combined)), channels)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """All column names in order."""
        return tuple(f"{prefix}{column}" for prefix, part in self.parts for column in part.column_names)

    def restricted_to(self, columns: Iterable[str]) -> "Plan":
        """Return the plan that computes only the features of these columns, in the order of this plan."""
        required = set(columns)
        parts = []
        for prefix, part in self.parts:
            if names := [name for name in part.column_names if f"{prefix}{name}" in required]:
                parts.append((prefix, part.restricted_to(names)))
        return Plan(tuple(parts), self.channels)

    def compute(self, recording: Recording) -> Computed:
        """Compute the features of one recording. The computing time includes the search for phases."""
        start = time.perf_counter()
        views = views_of(recording, self.channels)
        values, reasons = [], []
        for prefix, part in self.parts:
            part_values, part_reasons = part.compute(views[prefix])
            values.append(part_values)
            reasons += [(f"{prefix}{feature}", reason) for feature, reason in part_reasons]
        phases = next(iter(views.values())).phases
        ms = 1e3 * (time.perf_counter() - start)
        return Computed(np.concatenate(values), tuple(reasons), ms, phases)

    @property
    def signals(self) -> tuple[str, ...]:
        """Auxiliary signals of a recording that the features read."""
        phases = {member.feature.phase for _, part in self.parts for member in part.members}
        is_read = {
            "friction": "friction" in phases,
            "speed": "travel" in phases,
            "turn_rate": not set(TURN_CHANNELS).isdisjoint(self.channels),
            "sound": SOUND_CHANNEL in self.channels,
        }
        return tuple(name for name, value in is_read.items() if value)

    def other_rates(self, recording: Recording) -> dict[str, float]:
        """Return the rates in Hz of the signals that the features read, if they are not `recording.fs`."""
        signals = self.signals
        return {name: rate for name, rate in recording.auxiliary_fs.items() if name in signals}

    def to_json(self) -> str:
        """Return the plan as JSON, with the registered names of the functions and a digest of their code."""
        parts = []
        for prefix, part in self.parts:
            members = [
                (m.name, f.name, m.parameters, m.columns, m.remove_hand_motion, f.function.__module__)
                for m, f in ((member, member.feature) for member in part.members)
            ]
            parts.append([prefix, {"name": part.name, "members": members, "code": code_hash(part)}])
        return json.dumps(parts)

    @classmethod
    def of_json(cls, text: str, channels: Iterable[str]) -> "tuple[Plan, bool]":
        """Return the plan that `to_json` has written, and whether the code of its features is unchanged.

        Raises
        ------
        KeyError, ValueError
            If the JSON does not describe a plan, or names an unknown feature.
        """
        parts, is_same = [], True
        for prefix, definition in json.loads(text):
            members = []
            for name, feature, parameters, columns, remove_hand_motion, module in definition["members"]:
                values = {k: tuple(v) if isinstance(v, list) else v for k, v in parameters.items()}
                members.append(
                    Member(name, find_feature(feature, module), values, tuple(columns), remove_hand_motion)
                )
            feature_set = FeatureSet(definition["name"], tuple(members))
            parts.append((str(prefix), feature_set))
            is_same = is_same and code_hash(feature_set) == definition["code"]
        return cls(tuple(parts), tuple(channels)), is_same
