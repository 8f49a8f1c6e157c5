"""Features of a movement's equal parts: each by itself, so that a classifier can let them vote."""

import functools
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from texclass.features.contract import UndefinedFeatureError
from texclass.features.view import STOPWATCH, PhaseView, transform
from texclass.recording import Samples

LEAST_PIECE = 2048
"""Samples that a piece must hold: with fewer, what is gained by voting is lost in each piece."""

Names = Callable[..., tuple[str, ...]]


def pieces(view: PhaseView, n_pieces: int) -> tuple[PhaseView, ...]:
    """Return views of equal pieces of the movement, or of all of it as one piece where it is too short.

    Too short is less than `n_pieces` times `LEAST_PIECE` samples; at most n_pieces - 1 samples at the end
    are left out.
    """
    if n_pieces == 1 or view.n_samples < n_pieces * LEAST_PIECE:
        return (view,)
    return _cut(view, n_pieces)


@transform
def _cut(view: PhaseView, n_pieces: int) -> tuple[PhaseView, ...]:
    size = view.n_samples // n_pieces
    return tuple(_piece(view, i, size) for i in range(n_pieces))


def _piece(view: PhaseView, i: int, size: int) -> PhaseView:
    piece = PhaseView(view.samples[i * size : (i + 1) * size], view.fs)
    if (timed := view.memory.get(STOPWATCH)) is not None:
        piece.memory[STOPWATCH] = lambda key, compute: timed((*key, f"piece {i + 1}"), compute)
    return piece


def divisible(function: Callable[..., Any]) -> Callable[..., Samples]:
    """Give a feature of a movement a keyword `n_pieces`, 1 by default, to compute it of equal parts.

    With n_pieces above 1, values are of shape (n_outputs, n_pieces), flat: the pieces of one output stand
    side by side. A movement too short for pieces (see `pieces`) counts as n_pieces equal ones: all of them
    have its value.

    Raises
    ------
    UndefinedFeatureError
        By the feature returned: if a piece has no value; the reason names the piece.
    ValueError
        By the feature returned: if `n_pieces` is not a whole number above 0.
    """

    @functools.wraps(function)
    def in_pieces(view: PhaseView, *, n_pieces: int = 1, **parameters: Any) -> Samples:
        if not isinstance(n_pieces, int) or n_pieces < 1:
            raise ValueError(f"n_pieces is {n_pieces!r}; the rule is a whole number of at least 1")
        if n_pieces == 1:
            return np.asarray(function(view, **parameters))
        found = [
            _value(function, piece, number, parameters)
            for number, piece in enumerate(pieces(view, n_pieces), 1)
        ]
        return np.broadcast_to(np.stack(found, axis=-1), (found[0].size, n_pieces)).reshape(-1)

    own = inspect.signature(function)
    added = inspect.Parameter("n_pieces", inspect.Parameter.KEYWORD_ONLY, default=1, annotation=int)
    in_pieces.__signature__ = own.replace(parameters=[*own.parameters.values(), added])  # type: ignore[attr-defined]
    return in_pieces


def named_pieces(outputs: Names) -> Names:
    """Let a function that names outputs name those of each piece: "b1.piece1", "b1.piece2", "b2.piece1"."""

    def names(*, n_pieces: int = 1, **parameters: Any) -> tuple[str, ...]:
        whole = outputs(**parameters)
        if n_pieces == 1:
            return whole
        return tuple(f"{name}.piece{i}" for name in whole for i in range(1, n_pieces + 1))

    return names


def _value(
    function: Callable[..., Any], piece: PhaseView, number: int, parameters: dict[str, Any]
) -> Samples:
    try:
        return np.atleast_1d(function(piece, **parameters))
    except UndefinedFeatureError as undefined:
        raise UndefinedFeatureError(f"piece {number}: {undefined}") from None
