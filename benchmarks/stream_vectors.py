"""Make examples/stream_vectors.json: what a port of examples/stream_logic.py has to give.

Bins and answers go through texclass's own `Contact` and `Evidence`; what comes out is written down.
"""

import json
from pathlib import Path

import numpy as np

from texclass.phases import bin_means
from texclass.recognition import Answer, Evidence
from texclass.recognition.live.contact import Contact, ContactRules

FILE = Path(__file__).resolve().parents[1] / "examples" / "stream_vectors.json"
FS, BIN, FINE = 4000.0, 20, 4
REST, STROKE = 1.0, 100.0
STROKES = [(60, 1), (160, 100), (20, 1), (90, 60), (140, 1)]
STREAMS = {
    # name: (in_contact, unit, white, stretches of (bins, power); a negative number: samples that are missing)
    "rest, two strokes, lift-off": (False, "arbitrary", True, STROKES),
    "a knock is no contact": (False, "arbitrary", True, [(60, 1), (6, 900), (150, 1)]),
    "begins in contact, which is asked for": (
        True, "m/s^2", True, [(80, 4), (60, 2.5), (130, 1e-3), (60, 1e-3), (150, 0.4), (120, 1e-3)],
    ),
    "begins in rest: steady and white": (None, "arbitrary", True, [(60, 5), (150, 500), (130, 5)]),
    "begins in contact: steady, not white": (None, "arbitrary", False, [(60, 5), (150, 7), (130, 1e-3)]),
    "begins in rest: below 6 mg": (None, "m/s^2", False, [(60, 1e-3), (150, 0.5), (130, 1e-3)]),
    "begins in contact: not steady": (None, "arbitrary", True, [(19, 1), (1, 4000), (60, 50), (130, 1e-3)]),
    "a short break is none": (False, "arbitrary", True, [*STROKES[:2], (-400, 0), *STROKES[3:]]),
    "a long break is a lift-off": (False, "arbitrary", True, [*STROKES[:2], (-4000, 0), (150, 60), (140, 1)]),
    "the floor follows the noise": (
        False, "arbitrary", True, [(60, 1), (900, 1.8), (160, 3.0), (160, 30), (140, 2)],
    ),
    "digital silence, then a stroke": (None, "m/s^2", True, [(60, 0), (30, 1e-4), (150, 1), (130, 0)]),
    "held values are no rest": (
        None, "arbitrary", True, [(30, 0), (60, 5), (40, 0), (60, 5), (150, 500), (130, 5)],
    ),
    "a steady level is the new floor": (
        False, "arbitrary", True,
        [(60, 1), (900, 40), (160, 4000), (140, 40), (400, 900), (140, 40), (799, 900), (140, 40)],
    ),
    "begins with a steady level, not white": (None, "arbitrary", False, [(900, 5), (160, 500), (140, 5)]),
    "a stated contact stays one": (True, "arbitrary", True, [(900, 5), (160, 9)]),
}  # fmt: skip
MOVED = "moves on to another surface"
EVIDENCE = {
    MOVED: {"correlation": 0.05, "hop_s": 1.0},
    "independent windows": {"correlation": 0.0, "hop_s": 1.0},
    "overlapping windows of one contact": {"correlation": 0.3, "hop_s": 0.5, "lapse": 0.01},
    "nothing is known of how they agree": {"hop_s": 0.5},
    "what goes on forgets": {"correlation": 0.1, "hop_s": 0.5, "forget_s": 2.0, "lapse": 0.02},
    "majority": {"kind": "majority", "hop_s": 0.5},
    "majority that forgets": {"kind": "majority", "hop_s": 0.5, "forget_s": 2.0},
}
SURFACES = ("cork", "felt", "oak")
N_ANSWERS = 12


class Heard:
    """Stands for `Level`: bins of white vibration of given powers."""

    fs, bin_size = FS, BIN

    def __init__(self, white: bool) -> None:
        self.white, self.samples, self.first = white, [], 0

    def add(self, power: float) -> int:
        """Hear a bin more, and return where it ends."""
        self.samples += [power] * BIN
        return self.first + len(self.samples)

    def skip(self, n: int) -> None:
        self.first += len(self.samples) + n
        self.samples = []

    def fine(self, start: int, stop: int) -> tuple[int, int, np.ndarray]:
        start = max(start, self.first)
        return start, FINE, bin_means(np.array(self.samples[start - self.first : stop - self.first]), FINE)

    def correlation(self, start: int, stop: int) -> float:
        return 0.0 if self.white else 0.9


def contacts() -> list[dict]:
    """Return streams of bins with the events that texclass tells."""
    found = []
    for name, (asked, unit, white, stretches) in STREAMS.items():
        heard = Heard(white)
        contact = Contact(heard, ContactRules(), asked, unit)
        events = []
        for n, power in stretches:
            if n < 0:
                at = heard.first + len(heard.samples)
                heard.skip(-n)
                events += contact.interrupt(at, -n, -n / FS)
            for _ in range(n):
                events += contact.step(heard.add(float(power)), float(power))
        told = [{"kind": e.kind, "sample": e.sample, "known": e.known} for e in events if e.kind != "tap"]
        taps = sum(e.kind == "tap" for e in events)
        constants = contact.constants
        felt = [[n, float(power)] for n, power in stretches]
        vector = {"name": name, "white": white, "constants": constants, "stretches": felt}
        found.append({**vector, "events": told, "n_taps": taps})
    return found


def evidence() -> list[dict]:
    """Return answers of windows, with what texclass makes of them together."""
    rng, found = np.random.default_rng(0), []
    p = np.round(rng.dirichlet([2.0, 1.0, 0.7], N_ANSWERS), 4)
    p[:, 0] = np.round(1 - p[:, 1:].sum(axis=1), 4)
    p[4] = [1.0, 0.0, 0.0]
    drawn = (rng.random(N_ANSWERS) < 0.4).tolist()
    moved = np.array([[0.9, 0.06, 0.04]] * 6 + [[0.05, 0.05, 0.9]] * 6)
    for name, settings in EVIDENCE.items():
        rows, unknown = (moved, [False] * N_ANSWERS) if name == MOVED else (p, drawn)
        together = Evidence(SURFACES, window_s=1.0, **settings)
        verdicts = []
        for i, (row, strange) in enumerate(zip(rows.tolist(), unknown, strict=True)):
            answer = Answer("", "", 0.0, "", strange, 0.0, (), dict(zip(SURFACES, row, strict=True)))
            said = together.add(answer, float(i))
            p_together = list(said.probabilities.values())
            verdicts.append({"probabilities": p_together, "unknown": said.unknown, "sure": said.sure})
        vector = {"name": name, "constants": together.constants, "probabilities": rows.tolist()}
        found.append({**vector, "unknown": unknown, "verdicts": verdicts})
    return found


def made() -> dict:
    """Return all vectors."""
    return {"fs_hz": FS, "contact": contacts(), "evidence": evidence()}


if __name__ == "__main__":
    FILE.write_text(json.dumps(made(), indent=1) + "\n", encoding="utf-8")
