"""How right first answers are, and how soon the evidence of a contact makes up for them, on `biotac20`."""

from typing import Any

import numpy as np
from stream_models import TRAINED_REPETITIONS, biotac_recordings

from texclass.experiment.accuracy import wilson_interval
from texclass.recognition import (
    Evidence,
    Model,
    OnlineRecogniser,
    OnlineSettings,
    WindowAnswer,
    expected_calibration_error,
)
from texclass.recording import Recording, Samples

SECONDS = (0.25, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
HOP_S = 0.125
DISCOUNTS = (1.0, 0.5, 0.25, 0.1)


def accuracy_after_seconds(model: Model, every: int = 1) -> dict[str, Any]:
    """Stream the repetitions the model was not trained on and say what it says after each time."""
    dataset = biotac_recordings(range(TRAINED_REPETITIONS + 1, 41))
    indices = range(0, len(dataset), every)
    streams = []
    for index in indices:
        recording = dataset[index]
        streams.append((str(recording.material), heard(model, recording), recording.fs))
    first = [answers[0] for _, answers, _ in streams]
    found: dict[str, Any] = {
        "dataset": dataset.name,
        "input_hash": dataset.input_hash,
        "n_recordings": len(streams),
        "trained_on": f"repetitions 1 to {TRAINED_REPETITIONS}",
        "window_s": model.manifest.touch_s,
        "hop_s": HOP_S,
        "first_answer_s": {
            "of signal": max(a.known / fs for a, (_, _, fs) in zip(first, streams, strict=True)),
            "and milliseconds of computing, 99 %": float(np.quantile([a.ms for a in first], 0.99)),
        },
        "curves": {},
    }
    for kind in ("sequential", "majority"):
        found["curves"][kind] = [_at(streams, model, t, kind, 0.5) for t in SECONDS]
    found["discounts"] = {
        str(d): [_at(streams, model, t, "sequential", d)["calibration_error"] for t in SECONDS]
        for d in DISCOUNTS
    }
    found["stopped"] = _stopped(streams, model)
    return found


def heard(model: Model, recording: Recording, block_s: float = 0.025) -> list[WindowAnswer]:
    """Return the answers of a recording's stream."""
    live, found = OnlineRecogniser(model, settings=OnlineSettings(hop_s=HOP_S)), []
    n = round(block_s * recording.fs)
    for k in range(0, recording.n_samples, n):
        found += live.push(recording.acceleration[k : k + n])
    return [update for update in found if isinstance(update, WindowAnswer)]


def _evidence(model: Model, kind: Any, discount: float, fs: float) -> Evidence:
    return Evidence(
        model.materials, kind, window_s=float(model.manifest.touch_s or 1), hop_s=HOP_S, discount=discount
    )


def _at(streams: Any, model: Model, seconds: float, kind: str, discount: float) -> dict[str, Any]:
    """Return accuracy and calibration of the verdicts known after so many seconds."""
    hits, p = [], []
    for material, answers, fs in streams:
        evidence = _evidence(model, kind, discount, fs)
        told = [a for a in answers if a.known / fs <= seconds + 1e-9] or answers[:1]
        verdict = [evidence.add(a.answer, (a.stop - a.onset) / fs) for a in told][-1]
        hits.append(verdict.surface == material)
        p.append(verdict.probability)
    low, high = wilson_interval(sum(hits), len(hits))
    return {
        "seconds": seconds,
        "accuracy": float(np.mean(hits)),
        "low": low,
        "high": high,
        "calibration_error": expected_calibration_error(p, hits),
    }


def _stopped(streams: Any, model: Model) -> dict[str, float]:
    """Return what stopping at the first sure verdict gives: accuracy, and seconds it took."""
    hits: list[bool] = []
    seconds: list[float] = []
    n_sure = 0
    for material, answers, fs in streams:
        evidence = _evidence(model, "sequential", 0.5, fs)
        for a in answers:
            verdict = evidence.add(a.answer, (a.stop - a.onset) / fs)
            if verdict.sure:
                n_sure += 1
                break
        hits.append(verdict.surface == material)
        seconds.append(verdict.felt_s)
    taken: Samples = np.array(seconds)
    return {
        "accuracy": float(np.mean(hits)),
        "share_sure": n_sure / len(hits),
        "median_s": float(np.median(taken)),
        "p90_s": float(np.quantile(taken, 0.9)),
    }
