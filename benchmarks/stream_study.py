"""Streams: cost, equality with batch predictions, and seconds to a correct prediction.

Run it by hand from the project's root: `python benchmarks/stream_study.py [--part NAME]
[--models DIR]`. Each part (speed, memory, equality-simulated, equality-biotac20, accuracy) writes its section
of reports/studies/stream.json; what is told in robot.md is then written from all of them. One thread.
`--models` keeps trained models in a folder; `--every N` takes every n-th recording only. Times are those of
single pushes: median and p99 of all of them, as a robot gets them; and, the same blocks pushed several times
(`--rounds`), of the least of each, for the machine may be shared. Beside them stands what one `np.fft.rfft`
of 250,000 samples took in the same run.
"""

import itertools
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from study import command_line, in_turns, interval, table, timed, write

from texclass.evaluation import PipelineDefinition, cut_windows, load_pipeline, wilson_interval
from texclass.evaluation.pipeline import RowDefinition
from texclass.evaluation.windows import group_by_recording
from texclass.loaders import Dataset, open_dataset
from texclass.provenance import versions
from texclass.recognition import (
    Answer,
    Event,
    Evidence,
    Model,
    OnlineRecogniser,
    OnlineSettings,
    WindowAnswer,
    expected_calibration_error,
    load_model,
    train,
)
from texclass.recording import Recording, Samples
from texclass.reporting import Heading, Table

LIBRARIES = ("numpy", "scipy", "scikit-learn", "numba")
BLOCK_S, SPEED_S = 0.025, 30.0
N_REFERENCE = 250_000
BLOCKS = (1, 7, 250, 4096)
"""Samples a block, in which streams must be equal."""
SECONDS = (0.25, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
CORRELATIONS = (0.0, 0.1, 0.3, 1.0)
SEED = 2015
SPECTRUM = ("octave_level", "deep_octave_level")
"""Features that share one Fourier transform."""
SEVERAL_SCALES = (
    "band_level", "octave_level", "deep_octave_level", "slope_level", "slope_agreement",
    "curvature_agreement", "curvature_level", "curvature_shape", "vibration_level", "vibration_shape",
)  # fmt: skip
"""Features of a movement that short touches have; a stream has no friction channel."""
PRUNED_TOUCH_S, PRUNED_COLUMNS = 0.5, 16
BIOTAC_TOUCH_S, TRAINED_REPETITIONS = 0.25, 20
HOP_S = 0.125
"""From one window of `biotac20` to the next, in training and in the stream."""
BIOTAC_OPENING, BIOTAC_EVERY = 6, 4
"""The first windows of a slide all train, as its beginning is unlike the rest; then every fourth."""


# The models it listens with: trained in a minute or two each ------------------------------------------------


def model_of(name: str, folder: Path | None) -> Model:
    """Return a model from the folder, or train it.

    "pruned": 10 kHz, half a second, a few columns selected under a budget; "spectrum": the same of columns
    that share one Fourier transform; "biotac": a quarter of a second of repetitions 1 to 20 of `biotac20`.
    """
    path = folder and folder / f"{name}_model.skops"
    if path and path.is_file():
        return load_model(path)
    if name == "biotac":
        model = _biotac()
    else:
        pipeline = _pipeline(SPECTRUM if name == "spectrum" else SEVERAL_SCALES)
        budget = {"window_s": PRUNED_TOUCH_S, "max_features": PRUNED_COLUMNS}
        model = train(open_dataset("simulated"), pipeline, row="budget", **budget)
    if path is None:
        return model
    model.save(path)
    return load_model(path)


def _pipeline(features: tuple[str, ...]) -> PipelineDefinition:
    """Return the pipeline `texclass` with one row, of these features."""
    shipped = load_pipeline("texclass")
    row = RowDefinition(name="Several time scales", features=features)
    selected = shipped.features.restricted_to(features)
    return shipped.model_copy(update={"features": selected, "rows": (row,), "additions": ()})


def _biotac() -> Model:
    cut = cut_windows(biotac_recordings(range(1, TRAINED_REPETITIONS + 1)), BIOTAC_TOUCH_S, step=HOP_S)
    selected = [
        window
        for windows in group_by_recording(cut.entries)
        for i, window in enumerate(windows)
        # Other places in each repetition: a stream has its windows at all of them.
        if i < BIOTAC_OPENING or (i + (window.repetition or 0)) % BIOTAC_EVERY == 0
    ]
    model = train(replace(cut, entries=tuple(selected)), _pipeline(SEVERAL_SCALES), classifier="kernel")
    return replace(model, manifest=model.manifest.model_copy(update={"window_s": BIOTAC_TOUCH_S}))


def biotac_recordings(repetitions: range) -> Dataset:
    """Return the recordings of some repetitions of `biotac20`."""
    dataset = open_dataset("biotac20")
    entries = tuple(e for e in dataset.entries if e.repetition in repetitions)
    return replace(dataset, entries=entries, name=f"biotac20-repetitions{repetitions[0]}to{repetitions[-1]}")


# What is measured -------------------------------------------------------------------------------------------


def speed(models: dict[str, tuple[Model, float | None]], n_rounds: int) -> dict[str, Any]:
    """Push simulated recordings, one after the other, in blocks of 25 ms; each block several times."""
    dataset = open_dataset("simulated")
    found: dict[str, Any] = {"dataset": dataset.name, "input_hash": dataset.input_hash, "models": {}}
    for name, (model, hop_s) in models.items():
        blocks, rounds, reference = blocks_of(OnlineRecogniser(model), SPEED_S), [], []
        for _ in range(n_rounds + 1):  # the first round warms up
            live = OnlineRecogniser(model, settings=OnlineSettings(hop_s=hop_s))
            pushed = [timed(lambda: live.push(block), time.perf_counter) for block in blocks]  # noqa: B023
            rounds.append([1e3 * seconds for _, seconds in pushed])
            reference.append(reference_ms())
        ms, single = np.min(rounds[1:], axis=0), np.array(rounds[1:])
        busy = np.array(
            [any(isinstance(update, WindowAnswer) for update in updates) for updates, _ in pushed]
        )
        found["models"][name] = {
            "n_axes": live.n_columns,
            "fs": live.fs,
            "n_blocks": len(blocks),
            "columns": len(model.columns),
            "window_s": live.window / live.fs,
            "hop_s": live.hop / live.fs,
            "with_answers": busy.mean(),
            **{f"p{q:g}": np.percentile(ms, q) for q in (50, 90, 99, 99.9)},
            "single_p50": np.percentile(single, 50),
            "single_p99": np.percentile(single, 99),
            "single_busy_p50": np.percentile(single[:, busy], 50),
            "single_busy_p99": np.percentile(single[:, busy], 99),
            "mean": ms.mean(),
            "quiet": np.median(ms[~busy]),
            "busy": np.median(ms[busy]),
            "times_real_time": 1e3 * BLOCK_S / ms.mean(),
            "reference_ms": min(reference),
            "load": os.getloadavg()[0],
            "accuracy_of_a_window": model.manifest.accuracy["mean"],
        }
    return found


def memory(model: Model, seconds: float) -> dict[str, Any]:
    """Push an hour of simulated recordings and look at the memory of the process a dozen times."""
    live = OnlineRecogniser(model)
    blocks = itertools.cycle(blocks_of(live, 60.0))
    n_blocks, held = round(seconds / BLOCK_S), []
    start = time.process_time()
    for i, block in enumerate(itertools.islice(blocks, n_blocks)):
        live.push(block)
        if (i + 1) % (n_blocks // 12) == 0:
            pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
            held.append(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)
    return {
        "seconds": seconds,
        "memory_mb": held,
        "rings_mb": live.n_bytes / 1e6,
        "cpu_times_real_time": seconds / (time.process_time() - start),
        "reference_ms": reference_ms(),
    }


def blocks_of(live: OnlineRecogniser, seconds: float) -> list[Samples]:
    """Return simulated recordings of a total duration in blocks of 25 ms."""
    dataset, n = open_dataset("simulated"), round(BLOCK_S * live.fs)
    signals = (dataset[i].acceleration for i in itertools.cycle(range(0, len(dataset), 7)))
    blocks = (signal[k : k + n] for signal in signals for k in range(0, len(signal) - n + 1, n))
    return list(itertools.islice(blocks, round(seconds / BLOCK_S)))


def reference_ms() -> float:
    """Return what one `np.fft.rfft` takes, the least of five."""
    x = np.random.default_rng(SEED).standard_normal(N_REFERENCE)
    return 1e3 * in_turns({"rfft": lambda: np.fft.rfft(x)}, 5, n_warm=0)["rfft"].min()


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


def equality(model: Model, dataset: Dataset, every: int = 1) -> dict[str, Any]:
    """Compare streams of all recordings (or every n-th) with each other and with the model's own answers.

    Events, windows and answers must be identical, bit by bit, for all block sizes. Answers are compared with
    those of the model for the same samples cut from the recording, as a batch has them.
    """
    n_windows = n_other = n_blocks_differ = n_answered = 0
    largest, indices = 0.0, range(0, len(dataset), every)
    for index in indices:
        recording = dataset[index]
        known: dict[bytes, Answer] = {}
        said = []
        for n in BLOCKS:
            live: Any = OnlineRecogniser(model, settings=OnlineSettings(hop_s=model.manifest.window_s))
            live.model = Remembering(live.model, known)
            updates = [*push_all(live, recording.acceleration, n), *live.finish()]
            said.append([exactly(update) for update in updates])
        n_blocks_differ += sum(one != said[-1] for one in said[:-1])
        windows = [update for update in updates if isinstance(update, WindowAnswer)]
        n_answered += bool(windows)
        for window in windows:
            batch, own = model.answer(recording.cut(window.start, window.stop, "batch")), window.answer
            n_windows += 1
            n_other += batch.surface != own.surface or batch.unknown != own.unknown
            largest = max(largest, *(abs(p - own.probabilities[m]) for m, p in batch.probabilities.items()))
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


def push_all(live: OnlineRecogniser, signal: Samples, n: int) -> list[Any]:
    """Return the updates for a signal in blocks of n samples."""
    return [update for k in range(0, len(signal), n) for update in live.push(signal[k : k + n])]


def exactly(update: Any) -> tuple[Any, ...]:
    """Return all that two equal updates share."""
    if isinstance(update, Event):
        return update.kind, update.sample, update.n_received, update.end
    answer, verdict = update.answer, update.verdict
    return (
        update.start, update.stop, update.n_received, answer.surface, answer.unknown, answer.p_known,
        *answer.probabilities.values(), *verdict.probabilities.values(),
    )  # fmt: skip


def accuracy(model: Model, every: int = 1) -> dict[str, Any]:
    """Stream the held-out repetitions and return the accuracy after each time."""
    dataset = biotac_recordings(range(TRAINED_REPETITIONS + 1, 41))
    streams = []
    for index in range(0, len(dataset), every):
        recording = dataset[index]
        live = OnlineRecogniser(model, settings=OnlineSettings(hop_s=HOP_S))
        updates = push_all(live, recording.acceleration, round(BLOCK_S * recording.fs))
        answers = [update for update in updates if isinstance(update, WindowAnswer)]
        streams.append((str(recording.surface), answers, recording.fs))

    found = {"correlation": 1.0, "n_contacts": len(streams), **model.manifest.calibration}

    def verdicts(kind: Any, correlation: float) -> pd.DataFrame:
        """Return for each prediction the seconds so far, whether it is correct, and its confidence."""
        rows = []
        for i, (surface, answers, fs) in enumerate(streams):
            window_s = float(model.manifest.window_s or 1)
            evidence = Evidence(
                model.surfaces,
                kind,
                window_s=window_s,
                hop_s=HOP_S,
                correlation=correlation,
                lapse=1 / (found["n_contacts"] + 2),
            )
            for a in answers:
                said = evidence.add(a.answer, (a.stop - a.onset) / fs)
                rows.append(
                    (
                        i,
                        a.n_received / fs,
                        said.surface == surface,
                        said.probability,
                        said.sure,
                        said.contact_s,
                    )
                )
        return pd.DataFrame(rows, columns=["stream", "known_s", "right", "p", "sure", "felt_s"])

    def at(said: pd.DataFrame, seconds: float) -> dict[str, float]:
        """Return accuracy and calibration of the latest predictions after a time, or of the first."""
        known = said[(said["known_s"] <= seconds + 1e-9) | ~said["stream"].duplicated()]
        last = known.groupby("stream").last()
        low, high = wilson_interval(int(last["right"].sum()), len(last))
        error = expected_calibration_error(last["p"], last["right"])
        return {
            "seconds": seconds,
            "accuracy": last["right"].mean(),
            "low": low,
            "high": high,
            "calibration_error": error,
        }

    said = verdicts("sequential", found["correlation"])
    # Stopped at the first sure verdict, or at the end.
    stopped = said[said["sure"] | ~said["stream"].duplicated(keep="last")].groupby("stream").first()
    first = [answers[0] for _, answers, _ in streams]
    return {
        "dataset": dataset.name,
        "input_hash": dataset.input_hash,
        "n_recordings": len(streams),
        "trained_on": f"repetitions 1 to {TRAINED_REPETITIONS}",
        "window_s": model.manifest.window_s,
        "hop_s": HOP_S,
        "first_answer_s": {
            "of signal": said.groupby("stream")["known_s"].first().max(),
            "and milliseconds of computing, 99 %": np.quantile([a.compute_ms for a in first], 0.99),
        },
        "curves": {
            kind: [at(verdicts(kind, found["correlation"]), seconds) for seconds in SECONDS]
            for kind in ("sequential", "majority")
        },
        "correlation": found["correlation"],
        "correlations": {
            str(r): [at(verdicts("sequential", r), s)["calibration_error"] for s in SECONDS]
            for r in CORRELATIONS
        },
        "stopped": {
            "accuracy": stopped["right"].mean(),
            "share_sure": stopped["sure"].mean(),
            "median_s": stopped["felt_s"].median(),
            "p90_s": stopped["felt_s"].quantile(0.9),
        },
    }


def told_speed(s: dict[str, Any]) -> list[Any]:
    """Return the section on speed."""
    some = next(iter(s["models"].values()))
    rows = [
        {"name": name, "right": 100 * t["accuracy_of_a_window"], "answers": 100 * t["with_answers"]}
        | dict.fromkeys(("single_p50", "single_p99", "single_busy_p50", "single_busy_p99"), np.nan)
        | t
        | {"p999": t["p99.9"]}
        for name, t in s["models"].items()
    ]
    return [
        Heading("Speed"),
        f"{some['n_blocks']:,} blocks of 25 ms of `{s['dataset']}`, {some['n_axes']} axes at {some['fs']:g} "
        f"Hz, one thread; windows of {some['window_s']:g} s, pipelines pruned to the columns that a "
        "selection under a budget left. Wall time of each block: the least of several rounds, and of single "
        "passes, as a robot gets them (all blocks, and those with an answer).",
        table(
            rows,
            "pipeline = {name} | columns = {columns} | one window right % = {right:.1f} | "
            "a window every, s = {hop_s:g} | blocks with an answer % = {answers:.1f} | p50 ms = {p50:.3f} | "
            "p90 = {p90:.3f} | p99 = {p99:.3f} | p99.9 = {p999:.3f} | mean = {mean:.3f} | "
            "without an answer = {quiet:.3f} | with one = {busy:.3f} | single: p50 = {single_p50:.3f} | "
            "p99 = {single_p99:.3f} | with one: p50 = {single_busy_p50:.3f} | p99 = {single_busy_p99:.3f} | "
            "times real time = {times_real_time:.0f} | one rfft, ms = {reference_ms:.2f}",
        ),
        "The last column is the time of one `np.fft.rfft` of 250,000 samples in the same run. "
        f"The load average was {some['load']:.1f} on two cores.",
    ]


def told_memory(m: dict[str, Any]) -> list[Any]:
    """Return the section on memory."""
    held = m["memory_mb"]
    return [
        Heading("Memory"),
        f"{m['seconds'] / 3600:g} simulated hour: the process held {', '.join(f'{mb:.1f}' for mb in held)} "
        f"MB at twelfths of it, {held[-1] - held[0]:+.1f} MB from the first to the last; the rings take "
        f"{m['rings_mb']:.2f} MB. CPU time was 1/{m['cpu_times_real_time']:.0f} of the hour (one rfft: "
        f"{m['reference_ms']:.2f} ms).",
    ]


def told_equality(found: list[dict[str, Any]]) -> list[Any]:
    """Return the section on equality."""
    return [
        Heading("Stream equals batch"),
        "Streams in blocks of 1, 7, 250 and 4096 samples must give the same events, windows and answers bit "
        "by bit; each answer is compared with the model's for the same samples cut from the recording.",
        table(
            found,
            "dataset = {dataset} | recordings = {n_recordings} | "
            "with answers = {n_recordings_with_answers} | windows = {n_windows} | "
            "streams that differ by block = {n_streams_that_differ_by_block} | "
            "different labels = {n_different_labels} | "
            "largest difference of a probability = {largest_difference_of_probability:.1e}",
        ),
        "Where a dataset card removes the resting level, a stream removes the median of each window instead: "
        "rounding differs, labels do not.",
    ]


def told_accuracy(a: dict[str, Any]) -> list[Any]:
    """Return the section on accuracy against seconds."""
    curves, stopped, first = a["curves"], a["stopped"], a["first_answer_s"]
    rows = [
        {"s": s, "m": m, "own": interval(s), "other": interval(m)}
        for s, m in zip(curves["sequential"], curves["majority"], strict=True)
    ]
    correlations = pd.DataFrame(a["correlations"], index=[f"{s:g} s" for s in SECONDS]).T
    return [
        Heading("Accuracy against seconds"),
        f"{a['n_recordings']} recordings of `{a['dataset']}`, trained on {a['trained_on']}; windows of "
        f"{a['window_s']:g} s every {a['hop_s']:g} s. The first answer is there {first['of signal']:.3f} s "
        f"after contact, and {first['and milliseconds of computing, 99 %']:.1f} ms of computing (99 % of "
        "them). The beginning of a slide is unlike the rest: all windows of its first 0.9 s train, then "
        "every fourth. With windows every half second from the start on, the first one was learnt and the "
        "next ones were not: 84 % were right after 0.25 s, 76 % after 0.5 s.",
        table(
            rows,
            "seconds = {s[seconds]:g} | sequential % [95 %] = {own} | "
            "its calibration error = {s[calibration_error]:.3f} | majority % [95 %] = {other} | "
            "calibration error = {m[calibration_error]:.3f}",
        ),
        f"Stopped when sure (95 %): {100 * stopped['accuracy']:.1f} % right after {stopped['median_s']:.2f} "
        f"s (median; {stopped['p90_s']:.2f} s for nine in ten), {100 * stopped['share_sure']:.0f} % became "
        "sure.",
        "Calibration error of the sequential evidence by the correlation of windows of one contact "
        f"(training finds {a['correlation']:.2f}):",
        Table(correlations.reset_index(names="correlation")),
    ]


def main() -> None:
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "speed": lambda: speed(
            {
                "several time scales": (model_of("pruned", args.models), None),
                "spectrum": (model_of("spectrum", args.models), None),
                "spectrum, half as often": (model_of("spectrum", args.models), PRUNED_TOUCH_S),
            },
            args.rounds,
        ),
        "memory": lambda: memory(model_of("spectrum", args.models), args.hour),
        "equality-simulated": lambda: equality(
            model_of("pruned", args.models), open_dataset("simulated"), args.every
        ),
        "equality-biotac20": lambda: equality(
            model_of("biotac", args.models), open_dataset("biotac20"), args.every
        ),
        "accuracy": lambda: accuracy(model_of("biotac", args.models), args.every),
    }
    args = command_line(__doc__, every=1, rounds=40, hour=3600.0, part=tuple(parts), models=None)
    path = args.out / "stream.json"
    result = json.loads(path.read_text()) if path.is_file() else {}
    for name in args.part:
        run_settings = {"versions": versions(*LIBRARIES), "seed": SEED, "every": args.every}
        result[name] = parts[name]() | run_settings
        blocks = [
            *(told_speed(result["speed"]) if "speed" in result else ()),
            *(told_memory(result["memory"]) if "memory" in result else ()),
            *told_equality([each for part, each in result.items() if part.startswith("equality")]),
            *(told_accuracy(result["accuracy"]) if "correlations" in result.get("accuracy", {}) else ()),
        ]
        title = "Streams: speed, equality with batch, accuracy against signal length"
        write(args.out, "stream", result, title, blocks, provenance=run_settings)


if __name__ == "__main__":
    main()
