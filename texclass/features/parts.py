"""A long movement in parts: every feature at any length, in the memory that one part takes."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from texclass.features.contract import UndefinedFeatureError
from texclass.features.views import Views
from texclass.recording import Samples

if TYPE_CHECKING:
    from texclass.features.sets import Member

LONGEST = 3_000_000
"""Samples from which on a movement is computed in equal parts: 5 minutes at 10 kHz, some 200 MB."""

Outcome = Samples | str
"""The values of a feature, shape (n_columns,), or the reason why it has none."""


def outcomes(members: Sequence["Member"], views: Views) -> list[Outcome]:
    """Compute features on one channel of one recording, a movement above `LONGEST` in parts.

    A feature's value over a long movement is the mean of its values over the parts where it has one. What is
    read from taps, and what is declared to depend on the length, is computed as a whole.
    """
    spans = parts_of(views.phases.movement)
    found: list[list[Outcome]] = [[] for _ in members]
    for span in spans if len(spans) > 1 else ():
        part = replace(views, phases=replace(views.phases, movement=span))  # forgotten with its transforms
        for member, results in zip(members, found, strict=True):
            if _can_be_divided(member):
                results.append(outcome(member, part))
    return [
        mean_of(results) if results else outcome(member, views)
        for member, results in zip(members, found, strict=True)
    ]


def outcome(member: "Member", views: Views) -> Outcome:
    """Return what a feature gives, or why it gives nothing."""
    try:
        return member.values(views)
    except UndefinedFeatureError as undefined:
        return str(undefined)


def mean_of(results: Sequence[Outcome]) -> Outcome:
    """Return the mean of those that are values; the first reason if none is."""
    values = [result for result in results if not isinstance(result, str)]
    return np.mean(values, axis=0) if values else results[0]


def parts_of(movement: tuple[int, int] | None) -> tuple[tuple[int, int], ...]:
    """Return a movement [start, stop) as equal ranges of at most `LONGEST` samples; none without one."""
    if movement is None:
        return ()
    start, stop = movement
    if stop - start <= LONGEST:
        return (movement,)
    n_parts = -(-(stop - start) // LONGEST)
    return tuple(pairwise(np.linspace(start, stop, n_parts + 1).astype(int).tolist()))


def _can_be_divided(member: "Member") -> bool:
    return member.feature.phase != "tap" and "length" not in member.feature.depends_on
