"""Reference implementation of the logic of `texclass stream` in plain Python, for ports to other languages.

1. `Bins` converts samples to the power of the vibration in each bin.
2. `ContactDetector` detects contacts, strokes and lift-offs.
3. `Windows` selects the samples to classify with an ONNX file of `texclass export --from samples`.
4. `Evidence` combines the answers of one contact.

The constants are in the metadata of the ONNX file, as JSON under `texclass.stream`. docs/stream-logic.md has
the transitions as a table, stream_vectors.json contains test vectors. This file does not import texclass.
"""

import math
from collections import deque


class Bins:
    """Power of the vibration in each bin; constants as in texclass.stream, "contact"."""

    def __init__(self, constants, n_axes):
        self.c, self.n_axes, self.n_samples = constants, n_axes, 0
        self.skip(0)

    def skip(self, n):
        """Skip n missing samples and reset the filter."""
        self.n_samples += n
        self.start, self.sum, self.states = self.n_samples, 0.0, None
        self.previous, self.is_constant = None, True
        self.last, self.products, self.squares = [0.0] * self.n_axes, 0.0, 0.0

    @property
    def is_white(self):
        """Whether the correlation of neighbouring samples since the last break is that of noise."""
        correlation = self.products / self.squares if self.squares > 0 else 0.0
        return abs(correlation) <= self.c["white_correlation"]

    def push(self, sample):
        """Process a sample (one number per axis); return (start, stop, power) of a complete bin or None."""
        if self.states is None:
            rest = self.c["high_pass_rest"]
            self.states = [[[z0 * x, z1 * x] for z0, z1 in rest] for x in sample]
        self.is_constant = self.is_constant and self.previous in (None, list(sample))
        self.previous = list(sample)
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
        self.n_samples += 1
        n = self.n_samples - self.start
        if n < self.c["bin_samples"]:
            return None
        result = (self.start, self.n_samples, 0.0 if self.is_constant else self.sum / n)
        self.start, self.sum = self.n_samples, 0.0
        self.previous, self.is_constant = None, True
        return result


class ContactDetector:
    """State machine for contacts, strokes and lift-offs; constants as in texclass.stream, "contact"."""

    def __init__(self, constants):
        self.c, self.n = constants, constants["n_bins"]
        self.is_moving = bool(self.c["in_contact"])
        self.onset = self.active_stop = self.first_sample = 0
        self.floor = self.initial_level = self.level = self.peak_power = 0.0
        self.is_active, self.n_quiet, self.activity, self.opening_powers = False, 0, [], []
        self.recent_powers = deque(maxlen=self.n["smooth"])
        self.activity_flags = deque(maxlen=self.n["window"])
        self.block_powers, self.block_means = [], deque(maxlen=self.c["steady_blocks"])

    @property
    def state(self):
        """State, with its name in the table."""
        if self.initial_level:
            return "INITIAL"
        if not self.floor:
            return "STARTING"
        return "MOVING" if self.is_moving else "ACTIVE" if self.activity else "REST"

    def step(self, start, stop, power, is_white=True):
        """Process the bin of samples [start, stop), and return its events: (kind, sample).

        `is_white` (whether the correlation of neighbouring samples is at most c["white_correlation"]) matters
        only at the end of the opening.
        """
        self.recent_powers.append(power)
        self.level = sum(self.recent_powers) / len(self.recent_powers)
        self.peak_power = max(self.peak_power, power)
        if self.state == "STARTING":
            has_signal = power > 0 or self.c["in_contact"]
            return self._measure_opening(start, stop, power, is_white) if has_signal else []
        if self.state == "INITIAL":
            events = self._follow_initial_contact(stop)
        else:
            events = self._compare_with_floor(start, stop, power)
        return events + self._detect_steady_noise(power)

    def _detect_steady_noise(self, power):
        if self.c["in_contact"] or power == 0 or not self.is_moving:
            self._clear_blocks()
            return []
        self.block_powers.append(power)
        if len(self.block_powers) < self.n["block"]:
            return []
        means = self.block_means
        means.append(math.fsum(self.block_powers) / len(self.block_powers))
        self.block_powers = []
        is_full = len(means) == self.c["steady_blocks"]
        if not is_full or max(means) > self.c["steady_ratio"] * min(means):
            return []
        self.floor, self.initial_level = math.fsum(means) / len(means), 0.0
        return self._end_contact()

    def _clear_blocks(self):
        self.block_powers = []
        self.block_means.clear()

    def interrupt(self, sample, n_missing, fs):
        """Skip missing samples, and return the events."""
        events = [("break", sample)]
        self._clear_blocks()
        self.recent_powers.clear()
        self.activity_flags.clear()
        self.activity, self.is_active, self.opening_powers = [], False, []
        is_lift_off = self.is_moving and n_missing / fs > self.c["pause_s"]
        if is_lift_off:
            events += self._end_contact()
            self.is_moving = bool(self.initial_level)
        self.onset = self.active_stop = self.first_sample = sample + n_missing
        if self.is_moving and is_lift_off:
            events.append(("contact", self.onset))
        return events

    def _measure_opening(self, start, stop, power, is_white):
        events = []
        if not self.opening_powers:
            self.onset = start
            events = [("contact", start)] if self.c["in_contact"] else []
        self.opening_powers.append(power)
        self.active_stop = stop
        if len(self.opening_powers) < self.n["quiet"]:
            return events
        mean = math.fsum(self.opening_powers) / len(self.opening_powers)
        in_contact = self.c["in_contact"]
        if in_contact is None:
            is_steady = max(self.opening_powers) <= 10 * mean
            in_contact = mean > 0 and not (is_steady and (mean < self.c["rest_power"] or is_white))
        if in_contact:
            events = [] if self.is_moving else [("contact", self.onset)]
            self.is_moving, self.initial_level = True, mean or self.c["min_power"]
        else:
            self.floor = mean or self.c["min_power"]
        self.opening_powers = []
        return events

    def _follow_initial_contact(self, stop):
        level = max(self.level, self.c["min_power"])
        if self.level * self.c["drop_ratio"] >= self.initial_level:
            ratio = level / self.initial_level
            initial_level = max(self.initial_level, self.c["min_power"])
            self.initial_level = initial_level * ratio ** self.c["floor_weight"]
            self.n_quiet, self.active_stop = 0, stop
            return []
        self.n_quiet += 1
        if self.n_quiet < self.n["pause"]:
            return []
        self.floor, self.initial_level = level, 0.0
        return self._end_contact()

    def _compare_with_floor(self, start, stop, power):
        ratio = self.c["off_ratio"] if self.is_active else self.c["active_ratio"]
        floor = max(self.floor, self.c["rounding_ratio"] * self.peak_power, self.c["min_power"])
        self.is_active = self.level > ratio * floor
        self.activity_flags.append(self.is_active)
        events = []
        if self.is_active:
            if self.is_moving and self.n_quiet >= self.n["turn"]:
                events = [("stroke", start)]
            self.n_quiet, self.active_stop = 0, stop
            self.activity = [self.activity[0] if self.activity else start, stop]
        else:
            self.n_quiet += 1
            if not self.activity and power > 0:
                self.floor += self.c["floor_weight"] * (power - self.floor)
        if self.is_moving:
            return events + (self._end_contact() if self.n_quiet >= self.n["pause"] else [])
        if self.activity and self.n_quiet >= self.n["gap"]:
            self.activity = []  # texclass detects taps here
        elif self.activity and sum(self.activity_flags) >= self.c["share"] * self.n["window"]:
            # texclass applies the segmentation of recordings here, which also locates the onset.
            onset = max(self.activity[0] - self.c["bin_samples"], self.first_sample)
            self.is_moving, self.onset, self.activity = True, onset, []
            return [*events, ("contact", self.onset)]
        return events

    def _end_contact(self):
        self.is_moving, self.activity = False, []
        self.activity_flags.clear()
        self._clear_blocks()
        return [("lift-off", self.active_stop)]


class Windows:
    """Selection of the windows to classify; constants as in texclass.stream."""

    def __init__(self, constants):
        self.c, self.next_stop, self.next_free, self.queue = constants, 0, 0, deque()

    def handle_event(self, kind, sample):
        """Update the windows after an event."""
        if kind == "contact":
            self.next_stop = sample + self.c["window"]
        elif kind in {"lift-off", "break"}:
            self.queue.clear()

    def ready(self, n_received, active_stop):
        """Return the windows [start, stop) to classify after `n_received` samples."""
        while self.next_stop <= n_received:
            self.queue.append(self.next_stop)
            self.next_stop += self.c["hop"]
        windows = []
        while self.queue and self.queue[0] <= active_stop + self.c["turn"] and n_received >= self.next_free:
            stop = self.queue.popleft()
            windows.append((stop - self.c["window"], stop))
            self.next_free = n_received + self.c["spacing"]
        return windows


class Evidence:
    """Combination of the answers of one contact; constants as in texclass.stream, "evidence"."""

    def __init__(self, constants, n_surfaces):
        self.c, self.k = constants, n_surfaces
        self.reset()

    def reset(self):
        """Delete all answers, after a lift-off."""
        self.votes, self.sums = [0.0] * self.k, [0.0] * self.k
        self.weight = self.n_new = self.n_unknown = 0.0
        self.n, self.best, self.contrary = 0, None, []

    def add(self, p, is_unknown):
        """Add the answer of a window; return (probabilities, is_unknown, is_sure) of the contact."""
        if not self._has_changed(p, is_unknown):
            return self._add(p, is_unknown)
        windows = self.contrary
        self.reset()
        for window in windows:
            verdict = self._add(window, False)
        return verdict

    def _has_changed(self, p, is_unknown):
        """Return whether the last windows are sure of another surface than the contact so far."""
        c, best = self.c, p.index(max(p))
        if self.best is None or is_unknown or best == self.best or c["decay"] < 1:
            self.contrary = []
            return False
        if self.contrary and self.contrary[-1].index(max(self.contrary[-1])) != best:
            self.contrary = []
        self.contrary.append(p)
        n = 1 + (len(self.contrary) - 1) * c["new_share"]
        if n < c["change_windows"]:
            return False
        power = n / (1 + c["correlation"] * (n - 1)) / len(self.contrary)
        sums = [
            sum(math.log(max(q, c["min_probability"])) for q in qs) for qs in zip(*self.contrary, strict=True)
        ]
        odds = sum(math.exp(power * (s - max(sums))) for s in sums)
        return (1 - c["lapse"]) / odds + c["lapse"] / self.k >= c["confidence"]

    def _add(self, p, is_unknown):
        c, g = self.c, self.c["decay"]
        self.n += 1
        self.weight = g * self.weight + 1
        self.n_unknown = g * self.n_unknown + is_unknown
        if c["kind"] == "majority":
            self.votes = [g * v for v in self.votes]
            self.votes[p.index(max(p))] += 1
            self.sums = [g * s + q for s, q in zip(self.sums, p, strict=True)]
            scores = [v + 1 + 1e-6 * s / self.weight for v, s in zip(self.votes, self.sums, strict=True)]
        else:
            logs = [math.log(max(q, c["min_probability"])) for q in p]
            self.sums = [g * s + q for s, q in zip(self.sums, logs, strict=True)]
            top = max(self.sums)
            self.sums = [s - top for s in self.sums]
            self.n_new = g * self.n_new + (1.0 if self.n == 1 else c["new_share"])
            n_independent = self.n_new / (1 + c["correlation"] * max(self.n_new - 1, 0))
            scores = [math.exp(n_independent / self.weight * s) for s in self.sums]
        total = sum(scores)
        probabilities = [(1 - c["lapse"]) * s / total + c["lapse"] / self.k for s in scores]
        self.best = probabilities.index(max(probabilities))
        is_unknown = 2 * self.n_unknown >= self.weight
        return probabilities, is_unknown, max(probabilities) >= c["confidence"] and not is_unknown
