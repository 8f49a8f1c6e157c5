"""Whether a stream says what the model says of the same windows, for every division into blocks."""

import time
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np

from texclass.experiment.windows import cut
from texclass.loaders import Dataset
from texclass.recognition import Answer, Event, Model, OnlineRecogniser, OnlineSettings, WindowAnswer
from texclass.recording import Recording, Samples

BLOCKS = (1, 7, 250, 4096)
"""Samples a block."""


class Remembering:
    """A model that answers identical samples once: four streams of the same windows cost one."""

    def __init__(self, model: Model, known: dict[bytes, Answer]) -> None:
        self._model, self._known = model, known

    def answer(self, recording: Recording) -> Answer:
        """Return the answer that these samples had before, or a new one."""
        key = recording.acceleration.tobytes()
        if key not in self._known:
            self._known[key] = self._model.answer(recording)
        return self._known[key]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)


def equality(
    model: Model, dataset: Dataset, every: int = 1, say: Callable[[str], None] = print
) -> dict[str, Any]:
    """Compare streams of all recordings (or every n-th) with each other and with the model's own answers.

    Events, windows and answers must be identical, bit by bit, for all block sizes. Answers are compared with
    those of the model for the same samples cut from the recording, as a batch has them.
    """
    n_windows = n_other = n_blocks_differ = n_answered = 0
    largest, began = 0.0, time.monotonic()
    indices = range(0, len(dataset), every)
    for done, index in enumerate(indices, 1):
        recording = dataset[index]
        signal = recording.acceleration
        known: dict[bytes, Answer] = {}
        heard = [_heard(model, signal, n, known) for n in BLOCKS]
        told = [[_exactly(update) for update in one] for one in heard]
        n_blocks_differ += sum(one != told[-1] for one in told[:-1])
        windows = [update for update in heard[-1] if isinstance(update, WindowAnswer)]
        n_answered += bool(windows)
        for window in windows:
            batch = model.answer(cut(recording, window.start, window.stop, "batch"))
            n_windows += 1
            n_other += batch.surface != window.answer.surface or batch.unknown != window.answer.unknown
            largest = max(largest, *_differences(batch, window.answer))
        if done % 50 == 0:
            took = time.monotonic() - began
            say(f"{dataset.name}: {done} of {len(indices)}, {n_windows} windows, {took:.0f} s")
    return {
        "dataset": dataset.name,
        "input_hash": dataset.input_hash,
        "n_recordings": len(indices),
        "n_recordings_with_answers": n_answered,
        "n_windows": n_windows,
        "blocks": list(BLOCKS),
        "n_streams_that_differ_by_block": n_blocks_differ,
        "n_different_labels": n_other,
        "largest_difference_of_probability": largest,
    }


def _heard(model: Model, signal: Samples, n: int, known: dict[bytes, Answer]) -> list[Any]:
    """Return what a stream in blocks of n samples says."""
    live: Any = OnlineRecogniser(model, settings=OnlineSettings(hop_s=model.manifest.touch_s))
    live.model = Remembering(live.model, known)
    found: list[Any] = []
    for k in range(0, len(signal), n):
        found += live.push(signal[k : k + n])
    return [*found, *live.finish()]


def _exactly(update: Any) -> tuple[Hashable, ...]:
    if isinstance(update, Event):
        return update.kind, update.sample, update.known, update.end
    answer, verdict = update.answer, update.verdict
    return (
        update.start, update.stop, update.known, answer.surface, answer.unknown, answer.p_known,
        *answer.probabilities.values(), *verdict.probabilities.values(),
    )  # fmt: skip


def _differences(one: Answer, other: Answer) -> Samples:
    return np.abs([p - other.probabilities[m] for m, p in one.probabilities.items()])
