"""What `texclass stream` does around the windows, in plain Python: to be ported to C++, Rust or a controller.

Samples go into `Bins`. Bins of vibration go into `Contact`, which tells contacts, strokes and lift-offs;
`Windows` says which samples are to be answered; the answers of a file that `texclass export --from samples`
wrote go into `Evidence`. Numbers come from texclass.stream in its metadata. docs/stream-logic.md has the
transitions as a table, stream_vectors.json beside this file what has to come out. Nothing of texclass is
imported.
"""

import math
from collections import deque


class Bins:
    """Mean power of the vibration, bin by bin; constants as in texclass.stream, "contact"."""

    def __init__(self, constants, n_axes):
        self.c, self.n_axes, self.at = constants, n_axes, 0
        self.skip(0)

    def skip(self, n):
        """Go on n samples later, at rest on what comes then."""
        self.at += n
        self.start, self.sum, self.states = self.at, 0.0, None
        self.before, self.is_held = None, True
        self.last, self.products, self.squares = [0.0] * self.n_axes, 0.0, 0.0

    @property
    def white(self):
        """Whether neighbouring samples since the last break correlate as little as noise does."""
        correlation = self.products / self.squares if self.squares > 0 else 0.0
        return abs(correlation) <= self.c["white"]

    def push(self, sample):
        """Take in a sample (a number an axis); return (start, stop, power) where a bin is full, else None."""
        if self.states is None:
            rest = self.c["high_pass_rest"]
            self.states = [[[z0 * x, z1 * x] for z0, z1 in rest] for x in sample]
        self.is_held = self.is_held and self.before in (None, list(sample))
        self.before = list(sample)
        for axis, x in enumerate(sample):
            v = x
            for (b0, b1, b2, _, a1, a2), z in zip(self.c["high_pass"], self.states[axis], strict=True):
                y = b0 * v + z[0]
                z[0], z[1] = b1 * v - a1 * y + z[1], b2 * v - a2 * y
                v = y
            self.sum += v * v
            self.squares += v * v
            self.products += v * self.last[axis]
            self.last[axis] = v
        self.at += 1
        if self.at - self.start < self.c["bin_samples"]:
            return None
        full = (self.start, self.at, 0.0 if self.is_held else self.sum / (self.at - self.start))
        self.start, self.sum = self.at, 0.0
        self.before, self.is_held = None, True
        return full


class Contact:
    """What the tool does, bin by bin; constants as in texclass.stream, "contact"."""

    def __init__(self, constants):
        self.c, self.n = constants, constants["n_bins"]
        self.moving = bool(self.c["in_contact"])
        self.onset = self.until = self.first = 0
        self.floor = self.felt = self.level = self.peak = 0.0
        self.on, self.quiet, self.run, self.opening = False, 0, [], []
        self.recent = deque(maxlen=self.n["smooth_s"])
        self.active = deque(maxlen=self.n["window_s"])
        self.block, self.blocks = [], deque(maxlen=self.c["steady_blocks"])

    @property
    def state(self):
        """Return the state by its name in the table."""
        if self.felt:
            return "BEGUN"
        if not self.floor:
            return "LISTENING"
        return "MOVING" if self.moving else "TOUCHED" if self.run else "REST"

    def step(self, start, stop, power, white=True):
        """Take in samples [start, stop) of mean power `power`; return what is known now: (kind, sample).

        `white` is asked once, when the stream has opened: whether neighbouring samples since its start
        correlate by at most c["white"].
        """
        self.recent.append(power)
        self.level = sum(self.recent) / len(self.recent)
        self.peak = max(self.peak, power)
        if self.state == "LISTENING":
            return self._listen(start, stop, power, white) if power > 0 or self.c["in_contact"] else []
        said = self._begun(stop) if self.state == "BEGUN" else self._follow(start, stop, power)
        return said + self._steady(power)

    def _steady(self, power):
        if self.c["in_contact"] or power == 0 or not self.moving:
            self._forget_blocks()
            return []
        self.block.append(power)
        if len(self.block) < self.n["block_s"]:
            return []
        self.blocks.append(math.fsum(self.block) / len(self.block))
        self.block = []
        is_full = len(self.blocks) == self.c["steady_blocks"]
        if not is_full or max(self.blocks) > self.c["steady_ratio"] * min(self.blocks):
            return []
        self.floor, self.felt = math.fsum(self.blocks) / len(self.blocks), 0.0
        return self._lift()

    def _forget_blocks(self):
        self.block = []
        self.blocks.clear()

    def interrupt(self, at, missing, fs):
        """Go on after missing samples."""
        said = [("break", at)]
        self._forget_blocks()
        self.recent.clear()
        self.active.clear()
        self.run, self.on, self.opening = [], False, []
        lifted = self.moving and missing / fs > self.c["pause_s"]
        if lifted:
            said += self._lift()
            self.moving = bool(self.felt)
        self.onset = self.until = self.first = at + missing
        if self.moving and lifted:
            said.append(("contact", self.onset))
        return said

    def _listen(self, start, stop, power, white):
        said = []
        if not self.opening:
            self.onset = start
            said = [("contact", start)] if self.c["in_contact"] else []
        self.opening.append(power)
        self.until = stop
        if len(self.opening) < self.n["quiet_s"]:
            return said
        mean = math.fsum(self.opening) / len(self.opening)
        moves = self.c["in_contact"]
        if moves is None:
            steady = max(self.opening) <= 10 * mean
            moves = mean > 0 and not (steady and (mean < self.c["rest_power"] or white))
        if moves:
            said = [] if self.moving else [("contact", self.onset)]
            self.moving, self.felt = True, mean or self.c["least"]
        else:
            self.floor = mean or self.c["least"]
        self.opening = []
        return said

    def _begun(self, stop):
        if self.level * self.c["drop_ratio"] >= self.felt:
            now = max(self.level, self.c["least"])
            self.felt = max(self.felt, self.c["least"]) * (now / self.felt) ** self.c["floor_forget"]
            self.quiet, self.until = 0, stop
            return []
        self.quiet += 1
        if self.quiet < self.n["pause_s"]:
            return []
        self.floor, self.felt = max(self.level, self.c["least"]), 0.0
        return self._lift()

    def _follow(self, start, stop, power):
        ratio = self.c["off_ratio"] if self.on else self.c["active_ratio"]
        self.on = self.level > ratio * max(self.floor, self.c["dead"] * self.peak, self.c["least"])
        self.active.append(self.on)
        said = []
        if self.on:
            if self.moving and self.quiet >= self.n["turn_s"]:
                said = [("stroke", start)]
            self.quiet, self.until = 0, stop
            self.run = [self.run[0] if self.run else start, stop]
        else:
            self.quiet += 1
            if not self.run and power > 0:
                self.floor += self.c["floor_forget"] * (power - self.floor)
        if self.moving:
            return said + (self._lift() if self.quiet >= self.n["pause_s"] else [])
        if self.run and self.quiet >= self.n["gap_s"]:
            self.run = []  # texclass looks for taps here
        elif self.run and sum(self.active) >= self.c["share"] * self.n["window_s"]:
            # texclass asks the core that segments recordings whether this is a movement, and since when
            self.moving, self.onset = True, max(self.run[0] - self.c["bin_samples"], self.first)
            self.run = []
            return [*said, ("contact", self.onset)]
        return said

    def _lift(self):
        self.moving, self.run = False, []
        self.active.clear()
        self._forget_blocks()
        return [("lift-off", self.until)]


class Windows:
    """Which windows are to be answered; constants as in texclass.stream."""

    def __init__(self, constants):
        self.c, self.next, self.free_from, self.due = constants, 0, 0, deque()

    def after(self, kind, sample):
        """Take note of an event."""
        if kind == "contact":
            self.next = sample + self.c["window"]
        elif kind in {"lift-off", "break"}:
            self.due.clear()

    def ready(self, known, until):
        """Return windows [start, stop), at most one: `known` samples have come, vibration lasted `until`."""
        while self.next <= known:
            self.due.append(self.next)
            self.next += self.c["hop"]
        found = []
        while self.due and self.due[0] <= until + self.c["turn"] and known >= self.free_from:
            stop = self.due.popleft()
            found.append((stop - self.c["window"], stop))
            self.free_from = known + self.c["spread"]
        return found


class Evidence:
    """What the windows of one contact say together; constants as in texclass.stream, "evidence"."""

    def __init__(self, constants, n_surfaces):
        self.c, self.k = constants, n_surfaces
        self.reset()

    def reset(self):
        """Forget everything, after a lift-off."""
        self.votes, self.sum = [0.0] * self.k, [0.0] * self.k
        self.weight = self.worth = self.strange = 0.0
        self.n, self.best, self.contrary = 0, None, []

    def add(self, p, unknown):
        """Take in probabilities and verdict of a window; return (probabilities, unknown, sure)."""
        if not self._changes(p, unknown):
            return self._add(p, unknown)
        windows = self.contrary
        self.reset()
        for window in windows:
            verdict = self._add(window, False)
        return verdict

    def _changes(self, p, unknown):
        """Whether the last windows, this one included, are of another surface than those before."""
        c, named = self.c, p.index(max(p))
        if self.best is None or unknown or named == self.best or c["decay"] < 1:
            self.contrary = []
            return False
        if self.contrary and self.contrary[-1].index(max(self.contrary[-1])) != named:
            self.contrary = []
        self.contrary.append(p)
        n = 1 + (len(self.contrary) - 1) * c["new_share"]
        if n < c["change_windows"]:
            return False
        worth = n / (1 + c["correlation"] * (n - 1)) / len(self.contrary)
        sums = [
            sum(math.log(max(q, c["min_probability"])) for q in qs) for qs in zip(*self.contrary, strict=True)
        ]
        odds = sum(math.exp(worth * (s - max(sums))) for s in sums)
        return (1 - c["lapse"]) / odds + c["lapse"] / self.k >= c["confidence"]

    def _add(self, p, unknown):
        c, g = self.c, self.c["decay"]
        self.n += 1
        self.weight = g * self.weight + 1
        self.strange = g * self.strange + unknown
        if c["kind"] == "majority":
            self.votes = [g * v for v in self.votes]
            self.votes[p.index(max(p))] += 1
            self.sum = [g * s + q for s, q in zip(self.sum, p, strict=True)]
            together = [v + 1 + 1e-6 * s / self.weight for v, s in zip(self.votes, self.sum, strict=True)]
        else:
            logs = [math.log(max(q, c["min_probability"])) for q in p]
            self.sum = [g * s + q for s, q in zip(self.sum, logs, strict=True)]
            top = max(self.sum)
            self.sum = [s - top for s in self.sum]
            self.worth = g * self.worth + (1.0 if self.n == 1 else c["new_share"])
            worth = self.worth / (1 + c["correlation"] * max(self.worth - 1, 0))
            together = [math.exp(worth / self.weight * s) for s in self.sum]
        total = sum(together)
        together = [(1 - c["lapse"]) * t / total + c["lapse"] / self.k for t in together]
        self.best = together.index(max(together))
        unknown = 2 * self.strange >= self.weight
        return together, unknown, max(together) >= c["confidence"] and not unknown
