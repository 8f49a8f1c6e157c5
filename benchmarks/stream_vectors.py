"""Write examples/stream_vectors.json: test vectors for ports of examples/stream_logic.py.

The expected outputs are those of `ContactDetector` and `Evidence` of texclass.
"""

import json
from pathlib import Path

import numpy as np

from texclass.phases import bin_means
from texclass.recognition import Answer, Evidence
from texclass.recognition.live.contact import ContactDetector, ContactSettings

FILE = Path(__file__).resolve().parents[1] / "examples" / "stream_vectors.json"
FS, BIN, FINE = 4000.0, 20, 4
REST, STROKE = 1.0, 100.0
STROKES = [(60, 1), (160, 100), (20, 1), (90, 60), (140, 1)]
STREAMS: dict[str, tuple[bool, str, bool, list[tuple[int, float]]]] = {
    # name: (in_contact, unit, is_white, pairs of number of bins and power; negative: missing samples)
    "rest, two strokes, lift-off": (False, "arbitrary", True, STROKES),
    "a knock is not a contact": (False, "arbitrary", True, [(60, 1), (6, 900), (150, 1)]),
    "starts in contact, as stated": (
        True, "m/s^2", True, [(80, 4), (60, 2.5), (130, 1e-3), (60, 1e-3), (150, 0.4), (120, 1e-3)],
    ),
    "starts in rest: steady and white": (None, "arbitrary", True, [(60, 5), (150, 500), (130, 5)]),
    "starts in contact: steady, not white": (None, "arbitrary", False, [(60, 5), (150, 7), (130, 1e-3)]),
    "starts in rest: below 6 mg": (None, "m/s^2", False, [(60, 1e-3), (150, 0.5), (130, 1e-3)]),
    "starts in contact: not steady": (None, "arbitrary", True, [(19, 1), (1, 4000), (60, 50), (130, 1e-3)]),
    "a short break is not a lift-off": (False, "arbitrary", True, [*STROKES[:2], (-400, 0), *STROKES[3:]]),
    "a long break is a lift-off": (False, "arbitrary", True, [*STROKES[:2], (-4000, 0), (150, 60), (140, 1)]),
    "the floor follows the noise": (
        False, "arbitrary", True, [(60, 1), (900, 1.8), (160, 3.0), (160, 30), (140, 2)],
    ),
    "digital silence, then a stroke": (None, "m/s^2", True, [(60, 0), (30, 1e-4), (150, 1), (130, 0)]),
    "held values are not rest": (
        None, "arbitrary", True, [(30, 0), (60, 5), (40, 0), (60, 5), (150, 500), (130, 5)],
    ),
    "a steady level is the new floor": (
        False, "arbitrary", True,
        [(60, 1), (900, 40), (160, 4000), (140, 40), (400, 900), (140, 40), (799, 900), (140, 40)],
    ),
    "starts with a steady level, not white": (None, "arbitrary", False, [(900, 5), (160, 500), (140, 5)]),
    "a stated contact has no steady noise": (True, "arbitrary", True, [(900, 5), (160, 9)]),
}  # fmt: skip
MOVED = "moves to another surface"
EVIDENCE = {
    MOVED: {"correlation": 0.05, "hop_s": 1.0},
    "independent windows": {"correlation": 0.0, "hop_s": 1.0},
    "overlapping windows of one contact": {"correlation": 0.3, "hop_s": 0.5, "lapse": 0.01},
    "nothing is known of how they agree": {"hop_s": 0.5},
    "evidence fades": {"correlation": 0.1, "hop_s": 0.5, "forget_s": 2.0, "lapse": 0.02},
    "majority": {"kind": "majority", "hop_s": 0.5},
    "majority that fades": {"kind": "majority", "hop_s": 0.5, "forget_s": 2.0},
}
SURFACES = ("cork", "felt", "oak")
N_ANSWERS = 12


class FixedMeter:
    """Substitute for `LevelMeter`: bins with stated powers."""

    fs, bin_size = FS, BIN

    def __init__(self, is_white: bool) -> None:
        self.is_white, self.samples, self.first = is_white, [], 0

    def add(self, power: float) -> int:
        """Add a bin, and return its end."""
        self.samples += [power] * BIN
        return self.first + len(self.samples)

    def skip(self, n: int) -> None:
        self.first += len(self.samples) + n
        self.samples = []

    def fine_powers(self, start: int, stop: int) -> tuple[int, int, np.ndarray]:
        start = max(start, self.first)
        return start, FINE, bin_means(np.array(self.samples[start - self.first : stop - self.first]), FINE)

    def correlation(self, start: int, stop: int) -> float:
        return 0.0 if self.is_white else 0.9


def contact_vectors() -> list[dict]:
    """Return streams of bins with their events."""
    vectors = []
    for name, (in_contact, unit, is_white, levels) in STREAMS.items():
        meter = FixedMeter(is_white)
        detector = ContactDetector(meter, ContactSettings(), in_contact, unit)
        updates = []
        for n, power in levels:
            if n < 0:
                sample = meter.first + len(meter.samples)
                meter.skip(-n)
                updates += detector.interrupt(sample, -n, -n / FS)
            for _ in range(n):
                updates += detector.step(meter.add(float(power)), float(power))
        events = [
            {"kind": event.kind, "sample": event.sample, "n_received": event.n_received}
            for event in updates
            if event.kind != "tap"
        ]
        vectors.append(
            {
                "name": name,
                "is_white": is_white,
                "constants": detector.constants,
                "levels": [[n, float(power)] for n, power in levels],
                "events": events,
                "n_taps": sum(event.kind == "tap" for event in updates),
            }
        )
    return vectors


def evidence_vectors() -> list[dict]:
    """Return sequences of answers with the verdicts after each of them."""
    rng, vectors = np.random.default_rng(0), []
    p = np.round(rng.dirichlet([2.0, 1.0, 0.7], N_ANSWERS), 4)
    p[:, 0] = np.round(1 - p[:, 1:].sum(axis=1), 4)
    p[4] = [1.0, 0.0, 0.0]
    random_unknown = (rng.random(N_ANSWERS) < 0.4).tolist()
    moved = np.array([[0.9, 0.06, 0.04]] * 6 + [[0.05, 0.05, 0.9]] * 6)
    for name, settings in EVIDENCE.items():
        rows, unknown = (moved, [False] * N_ANSWERS) if name == MOVED else (p, random_unknown)
        evidence = Evidence(SURFACES, window_s=1.0, **settings)
        verdicts = []
        for i, (row, is_unknown) in enumerate(zip(rows.tolist(), unknown, strict=True)):
            answer = Answer("", "", 0.0, "", is_unknown, 0.0, (), dict(zip(SURFACES, row, strict=True)))
            verdict = evidence.add(answer, float(i))
            probabilities = list(verdict.probabilities.values())
            verdicts.append(
                {"probabilities": probabilities, "unknown": verdict.unknown, "sure": verdict.sure}
            )
        vector = {"name": name, "constants": evidence.constants, "probabilities": rows.tolist()}
        vectors.append({**vector, "unknown": unknown, "verdicts": verdicts})
    return vectors


def all_vectors() -> dict:
    """Return all vectors."""
    return {"fs_hz": FS, "contact": contact_vectors(), "evidence": evidence_vectors()}


if __name__ == "__main__":
    FILE.write_text(json.dumps(all_vectors(), indent=1) + "\n", encoding="utf-8")
