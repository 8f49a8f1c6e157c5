"""Which features are computed on which channels: what of an extraction needs no library of learning."""

import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from texclass.features.contract import find_feature
from texclass.features.phase_view import pair_prefix, views_of
from texclass.features.sets import FeatureSet, Member, code_hash
from texclass.recording import Phases, Recording, Samples


class Computed(NamedTuple):
    """Values (n_columns,) of one recording, (feature, reason) pairs, milliseconds, and its phases."""

    values: Samples
    reasons: tuple[tuple[str, str], ...]
    ms: float
    phases: Phases


@dataclass(frozen=True)
class Plan:
    """Which part of a feature set is computed on which channel.

    Attributes
    ----------
    parts
        (column prefix, feature set) pairs; the prefix "" reads the combined channels.
    channels
        Names of the channels that are kept apart; empty when they are combined.
    """

    parts: tuple[tuple[str, FeatureSet], ...]
    channels: tuple[str, ...] = ()

    @classmethod
    def of(cls, feature_set: FeatureSet, channels: tuple[str, ...] = ()) -> "Plan":
        """Plan a set: on the combined channels; or on each channel, on each pair, and on the friction."""
        if not channels:
            return cls((("", feature_set),))
        felt, of_pair = feature_set.reading("tap", "movement", "travel"), feature_set.reading("pair")
        pairs = list(combinations(channels, 2)) if of_pair.members else []
        # A single channel has no pair; the reason is told where all channels are one.
        rest = feature_set.reading("friction") if pairs else feature_set.reading("friction", "pair")
        parts = [(f"{name}/", felt) for name in channels]
        parts += [(pair_prefix(*pair), of_pair) for pair in pairs]
        return cls((*parts, ("", rest)), channels)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """All column names in order."""
        return tuple(f"{prefix}{column}" for prefix, part in self.parts for column in part.column_names)

    def restricted_to(self, columns: Iterable[str]) -> "Plan":
        """Return the plan that computes only what these columns need, in the plan's order."""
        wanted = set(columns)
        kept = [(p, part, [c for c in part.column_names if f"{p}{c}" in wanted]) for p, part in self.parts]
        return Plan(tuple((p, part.restricted_to(names)) for p, part, names in kept if names), self.channels)

    def compute(self, recording: Recording) -> Computed:
        """Compute one recording, from segmentation to the last feature."""
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

    def to_json(self) -> str:
        """Return it as JSON: functions by their registered names, and a digest of their code."""
        described = []
        for prefix, part in self.parts:
            members = [
                (m.name, f.name, m.parameters, m.columns, m.remove_hand_motion, f.function.__module__)
                for m, f in ((member, member.feature) for member in part.members)
            ]
            described.append([prefix, {"name": part.name, "members": members, "code": code_hash(part)}])
        return json.dumps(described)

    @classmethod
    def of_json(cls, text: str, channels: Iterable[str]) -> "tuple[Plan, bool]":
        """Return what `to_json` described, and whether the code of its features is still the same.

        Raises
        ------
        KeyError, ValueError
            If it describes no plan, or names a feature that is not known here.
        """
        parts, same = [], True
        for prefix, stated in json.loads(text):
            members = []
            for name, feature, parameters, columns, remove_hand_motion, module in stated["members"]:
                values = {k: tuple(v) if isinstance(v, list) else v for k, v in parameters.items()}
                members.append(
                    Member(name, find_feature(feature, module), values, tuple(columns), remove_hand_motion)
                )
            feature_set = FeatureSet(stated["name"], tuple(members))
            parts.append((str(prefix), feature_set))
            same = same and code_hash(feature_set) == stated["code"]
        return cls(tuple(parts), tuple(channels)), same
