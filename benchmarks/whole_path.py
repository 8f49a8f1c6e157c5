"""Latency by stage from recorded samples (and from their file) to features and prediction.

Run it by hand from the project's root: `python benchmarks/whole_path.py --baselines-python PATH`. It writes
reports/studies/whole_path.json and .png. One thread, warm, CPU time of that thread; one `np.fft.rfft` of
one axis of the recording (the median of five), every stage and the baselines take turns in each round, and
medians over rounds are compared. Recordings of 6 s and longer are simulated, with taps and strokes; shorter
ones are cut out of a stroke. No recording states its phases. `--baselines-python`: an interpreter that
has TSFEL, librosa and aeon.
"""

import hashlib
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from feature_speed import Timer, baseline_versions, baselines
from matplotlib.figure import Figure
from study import command_line, in_turns, table, timed, write

from texclass.features import FeatureSet, load_feature_set
from texclass.features.phase_view import UndefinedFeatureError, Views
from texclass.loaders import load_recording, open_dataset
from texclass.phases import find_phases
from texclass.recognition import Model, train
from texclass.recording import Phases, Recording
from texclass.reporting import Heading, Table
from texclass.reporting.figure_style import INK, OURS
from texclass.simulate.recipe import Recipe

SEED = 0
SETS = ("strese2015", "texclass")
STAGES = ("segment", "condition", "transforms", "features")
BASELINES = {"minirocket": "MiniRocket, transform", "tsfel": "TSFEL", "mfcc": "librosa MFCC"}
N_WARM = 2
LONGEST_S = 25.0
"""Of recordings that baselines are given; of longer ones so much is written to a text file and read."""
AIMS = {
    "6 s, 3 axes, 10 kHz": {"texclass": 25.0, "texclass: segment": 8.0},
    "25 s, 3 axes, 10 kHz": {"texclass": 14.0, "texclass: segment": 6.0},
}
"""Transforms of the recording that a thing may take."""
BUDGET_MS = 6.0
"""Largest cost of the fast model in ms: segmentation and features of a recording of 4 s."""
TRAINED = """title = "Eight simulated surfaces"
format = "simulated"
[recipe]
n_surfaces = 8
n_recordings = 10
n_operators = 5
duration_s = 4.0
fs = 10000
seed = 3
"""


@dataclass(frozen=True)
class Case:
    """A recording by its length in seconds, number of axes and sampling rate in Hz."""

    duration_s: float
    n_axes: int = 3
    fs: float = 10_000.0

    def __str__(self) -> str:
        long = f"{self.duration_s / 60:g} min" if self.duration_s >= 60 else f"{self.duration_s:g} s"
        axes = "1 axis" if self.n_axes == 1 else f"{self.n_axes} axes"
        return f"{long}, {axes}, {self.fs / 1000:g} kHz"

    def recording(self) -> Recording:
        """Return the recording without phases."""
        recipe = Recipe(
            n_surfaces=1, n_recordings=1, n_operators=1, duration_s=max(self.duration_s, 6.0), fs=self.fs,
            seed=SEED,
        )  # fmt: skip
        whole = recipe.record(0, 1)
        axes = whole.acceleration[:, : self.n_axes]
        if self.duration_s < 6:
            start = sum(whole.phases.movement) // 2
            axes = axes[start : start + round(self.duration_s * self.fs)]
        return Recording(axes, self.fs, "m/s^2", str(self))


CASES = (
    *(Case(duration_s, n_axes) for duration_s in (0.25, 1.0, 6.0, 25.0, 600.0) for n_axes in (1, 3)),
    *(Case(6.0, fs=fs) for fs in (1000.0, 5000.0, 50_000.0)),
)


def stages(recording: Recording, feature_set: FeatureSet) -> dict[str, float]:
    """Return the seconds of each stage of one pass over a recording."""
    phases, segmented = timed(partial(find_phases, recording))
    seconds = dict.fromkeys(STAGES, 0.0) | {"segment": segmented}
    views, inside = Views(recording, phases), [0.0]

    def transform(key: tuple[Any, ...], compute: Callable[[], Any]) -> Any:
        inside.append(0.0)
        table_rows, took = timed(compute)
        seconds["transforms"] += took - inside.pop()
        inside[-1] += took
        return table_rows

    for member in feature_set.members:
        with suppress(UndefinedFeatureError):
            view, took = timed(partial(member.view, views))
            seconds["condition"] += took
            view.memory.timed = transform
        inside[:], start = [0.0], time.thread_time()
        with suppress(UndefinedFeatureError):
            member.values(views)
        seconds["features"] += time.thread_time() - start - inside[0]
    return seconds


def measure(case: Case, sets: Mapping[str, FeatureSet], n_rounds: int, python: Path | None) -> dict[str, Any]:
    """Return the medians over rounds of all that is done to one recording: CPU ms, and in transforms."""
    recording = case.recording()
    axis = np.ascontiguousarray(recording.acceleration.reshape(recording.n_samples, -1)[:, 0])
    interpreter = python if case.duration_s <= LONGEST_S else None
    timers: AbstractContextManager[dict[str, Timer]] = (
        baselines(interpreter, axis, case.fs, BASELINES) if interpreter else nullcontext({})
    )
    rounds: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder, timers as others:
        path = Path(folder) / "felt.csv"
        columns = np.column_stack([np.arange(recording.n_samples) / case.fs, recording.acceleration])
        names = ",".join(["t", *"xyz"[: case.n_axes]])
        np.savetxt(path, columns[: round(LONGEST_S * case.fs)], "%.6g", ",", header=names, comments="")
        for _ in range(N_WARM + n_rounds):
            row = {"rfft": float(np.median([timed(partial(np.fft.rfft, axis))[1] for _ in range(5)]))}
            row["read"] = timed(partial(load_recording, path, fs=case.fs, unit="m/s^2"))[1]
            for name, feature_set in sets.items():
                parts = stages(recording, feature_set)
                row |= {f"{name}: {stage}": took for stage, took in parts.items()}
                row[name] = sum(parts.values())
            rounds.append(row | {title: timer() for title, timer in others.items()})
    ms = 1e3 * pd.DataFrame(rounds[N_WARM:]).median()
    return {
        "recording": str(case),
        "phases": find_phases(recording).kind,
        "ms": ms.to_dict(),
        "ratio": (ms / ms.rfft).to_dict(),
        "input_hash": hashlib.sha256(recording.acceleration.tobytes()).hexdigest(),
    }


def answers(model: Model, n_rounds: int) -> dict[str, Any]:
    """Return the median CPU time in ms of a trained model from samples to prediction."""
    six, touch = Case(6.0).recording(), Case(1.0).recording()
    window = touch.with_(phases=Phases(movement=(0, touch.n_samples)))
    values = model.plan.compute(six).values  # noqa: PD011
    seconds = in_turns(
        {
            "6 s as recorded": partial(model.answer, six),
            "1 s of movement": partial(model.answer, window),
            "the same, its features": partial(model.plan.compute, window),
            "answer from features": partial(model.answer_values, values),
        },
        n_rounds,
    )
    return {
        "n_columns": len(model.columns),
        "recogniser": "{row}, {classifier}".format_map(model.manifest.pipeline),
        "right": model.manifest.accuracy["mean"],
        "ms": (1e3 * seconds.median()).to_dict(),
    }


def figure(ratios: pd.DataFrame) -> Figure:
    """Draw the stages of the set `texclass`, and their sum compared with the baselines."""
    picture = Figure(figsize=(10, 4.6), layout="constrained")
    stacked, compared = picture.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    offsets = np.zeros(len(ratios))
    for stage, colour in zip(STAGES, ("#3b6ea8", "#8fb3d9", "#d99a4e", "#8a5a2b"), strict=True):
        width = ratios[f"texclass: {stage}"].to_numpy()
        stacked.barh(ratios.index, width, left=offsets, color=colour, label=stage)
        offsets += width
    compared.plot(offsets, ratios.index, "o", color=OURS, label="texclass")
    for name, marker in zip(BASELINES.values(), "Ds^", strict=True):
        if name in ratios:
            compared.plot(
                ratios[name], ratios.index, marker, color=INK, mfc="none", label=f"{name}, one axis"
            )
    stacked.set(xlabel="times one rfft of one axis", title="set texclass, by stage")
    compared.set(xlabel="times one rfft of one axis", xscale="log", title="beside public libraries")
    stacked.invert_yaxis()
    for ax in (stacked, compared):
        ax.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    return picture


def main() -> None:
    args = command_line(__doc__, rounds=15, baselines_python=None)
    sets = {name: load_feature_set(name) for name in SETS}
    table_rows = [
        measure(case, sets, args.rounds if case.duration_s < 60 else 3, args.baselines_python)
        for case in CASES
    ]
    with tempfile.TemporaryDirectory() as folder:
        card = Path(folder) / "eight.toml"
        card.write_text(TRAINED, encoding="utf-8")
        dataset = open_dataset(card)
        answered = [
            answers(train(dataset, max_ms=max_ms), 4 * args.rounds) | {"max_ms": max_ms}
            for max_ms in (None, BUDGET_MS)
        ]
    ratios = pd.DataFrame(
        [row["ratio"] for row in table_rows], index=[row["recording"] for row in table_rows]
    )
    aims = [
        {"recording": name, "what": what, "ratio": ratios.loc[name, what], "aim": aim}
        for name, aimed in AIMS.items()
        for what, aim in aimed.items()
    ]
    result = {
        "recordings": table_rows,
        "aims": aims,
        "answers": answered,
        "n_rounds": args.rounds,
        "seed": SEED,
        "input_hash": {row["recording"]: row["input_hash"] for row in table_rows},
        "baseline_versions": baseline_versions(args.baselines_python) if args.baselines_python else {},
    }
    columns_shown = ["read", *(f"texclass: {stage}" for stage in STAGES), *SETS[::-1], *BASELINES.values()]
    cells = ratios.reindex(columns=columns_shown).map("{:.3g}".format).replace("nan", "")
    cells.insert(0, "rfft, ms", [f"{row['ms']['rfft']:.3f}" for row in table_rows])
    blocks = [
        f"One thread, warm, medians of {args.rounds} rounds in which all take turns (3 for 10 min), in "
        "times one `np.fft.rfft` of one axis of the same recording. `texclass` and `strese2015` are the "
        "whole path from the samples as recorded to the features of the set, phases found; reading a text "
        f"file (of at most {LONGEST_S:g} s) comes before it. Baselines are given one axis.",
        Table(cells.rename_axis("recording").reset_index(), "Times one rfft of one axis."),
        Heading("Against the aims"),
        table(aims, "recording = {recording} | what = {what} | times one rfft = {ratio:.1f} | aim = {aim:g}"),
        Heading("To the answer"),
        "Models that `train` chose for eight simulated surfaces, pruned, asked in the same process: by "
        f"default, and of at most {BUDGET_MS:g} ms for a recording as it came.",
        table(
            answered,
            "recogniser = {recogniser} | columns = {n_columns} | right, held out = {right:.3f} | "
            "6 s as recorded, ms = {ms[6 s as recorded]:.2f} | "
            "1 s of movement, ms = {ms[1 s of movement]:.2f} | "
            "of these, features = {ms[the same, its features]:.2f} | "
            "answer from features = {ms[answer from features]:.2f}",
        ),
    ]
    write(args.out, "whole_path", result, "Latency of the whole path by stage", blocks, figure(ratios))


if __name__ == "__main__":
    main()
