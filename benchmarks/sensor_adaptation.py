"""Loss of accuracy with another sensor, and recovery by `texclass adapt` with reference recordings.

`python benchmarks/sensor_adaptation.py [--draws N]` (a few minutes; of the default pipeline, of others by
`--pipelines`) writes reports/studies/sensor_adaptation.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy import signal
from study import command_line, table, write

from texclass.evaluation import cached_table, load_pipeline
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition import Model, train
from texclass.recognition.adaptation import adapt_to_rows
from texclass.recording import Recording, Samples
from texclass.reporting import Heading
from texclass.simulate import record_freehand
from texclass.simulate.recipe import Recipe
from texclass.simulate.tool import Sensor, Tool

SEED = 7
N_STRANGERS = 2
AIM, WORTH = 0.8, 0.05
PIPELINES = {"surfaces": "vote", "texclass": "kernel", "multiscale": "vote"}
RECIPE = Recipe(n_surfaces=24, n_recordings=20, n_operators=5, duration_s=6.0, fs=10_000, seed=2015)
Felt = Callable[[Samples, np.random.Generator], Samples]


def slower(x: Samples, up: int, down: int) -> Samples:
    """Return a signal as recorded at `up / down` of the rate and resampled to the rate."""
    there = signal.resample_poly(x, up, down, axis=0)
    return np.asarray(signal.resample_poly(there, down, up, axis=0)[: len(x)])


def noisy(x: Samples, rng: np.random.Generator, below_db: float) -> Samples:
    """Return x and white noise, so far below the median level of all recordings (122 counts)."""
    return np.asarray(x + 122.0 * 10 ** (-below_db / 20) * rng.standard_normal(x.shape))


CHANGES: dict[str, tuple[str, Felt]] = {
    "none": ("the same sensor", lambda x, rng: x),
    "low-pass": (
        "a softer mount: one pole at a quarter of half the rate",
        lambda x, rng: np.asarray(signal.lfilter(*signal.butter(1, 0.25), x)),
    ),
    "tilt": (
        "a mount that favours high frequencies: y[n] = x[n] - 0.9 x[n - 1]",
        lambda x, rng: np.asarray(signal.lfilter([1.0, -0.9], [1.0], x)),
    ),
    "gain": ("twice the gain", lambda x, rng: 2 * x),
    "half the rate": ("1100 Hz, asked with `--resample 2200`", lambda x, rng: slower(x, 1, 2)),
    "noise": ("white noise, 20 dB below the median level", partial(noisy, below_db=20.0)),
    "much noise": (
        "white noise, 10 dB below the median level: above that of the quiet surfaces",
        partial(noisy, below_db=10.0),
    ),
}
"""What another sensor does to `biotac20`."""
TOOLS: dict[str, tuple[str, dict[str, Any]]] = {
    "none": ("the same tool", {}),
    "mount": (
        "a heavier tip (45 g), a softer shaft (80 g at 250 Hz)",
        {"tool": Tool(tip_mass_kg=0.045, mode_mass_kg=0.08, mode_hz=250.0)},
    ),
    "sensor": (
        "a slower and noisier accelerometer (400 Hz, 150 micro-g per root hertz)",
        {"sensor": Sensor(bandwidth_hz=400.0, noise_ug_rt_hz=150.0)},
    ),
    "rate": ("4 kHz, asked with `--resample 10000`", {"fs": 4000.0}),
    "gain": ("twice the gain", {"gain": 2.0}),
}
"""Tools of the simulator."""
WAYS = {
    "3 surfaces": "one labelled recording of each of three surfaces, drawn",
    "3 surfaces x 3": "three labelled recordings of each of three surfaces, drawn",
    "unlabelled": "all recordings that are no tests, unlabelled",
    "20 unlabelled": "20 of these, drawn, unlabelled",
    "unlabelled of 5": "those of five surfaces, drawn, unlabelled",
}


def changed(dataset: Dataset, name: str) -> Dataset:
    """Return recordings as measured by another sensor."""
    change = CHANGES[name][1]

    def load(entry: Entry) -> Recording:
        recording = dataset.load(entry)
        rng = np.random.default_rng([SEED, *entry.recording_id.encode()])
        return recording.with_(acceleration=change(recording.acceleration, rng))

    return replace(dataset, load=load, input_hash=f"{dataset.input_hash} {name}")


def simulated(name: str) -> Dataset:
    """Return simulated recordings made with a tool; phases have to be found."""
    tool, surfaces = TOOLS[name][1], {s.name: i for i, s in enumerate(RECIPE.surfaces)}

    def load(entry: Entry) -> Recording:
        i, k = surfaces[entry.surface], int(entry.repetition or 0)
        who = (k - 1) % RECIPE.n_operators
        recording = record_freehand(
            RECIPE.surfaces[i],
            RECIPE.operators[who],
            duration_s=RECIPE.duration_s,
            fs=tool.get("fs", RECIPE.fs),
            seed=(RECIPE.seed, i, who, k),
            tool=tool.get("tool"),
            sensor=tool.get("sensor"),
            recording_id=entry.recording_id,
            repetition=k,
        )
        up, down = (5, 2) if "fs" in tool else (1, 1)
        n = round(RECIPE.duration_s * RECIPE.fs)
        acceleration, friction = (
            signal.resample_poly(x, up, down, axis=0)[:n] if up > 1 else x
            for x in (recording.acceleration, recording.friction)
        )
        return Recording(
            tool.get("gain", 1.0) * acceleration, RECIPE.fs, recording.unit, recording.recording_id,
            recording.surface,
            operator=recording.operator, repetition=k, friction=friction,
        )  # fmt: skip

    entries = tuple(Entry(name, of, who, repetition=k) for name, of, who, k in RECIPE.entries())
    return Dataset("simulated", entries, load, f"{RECIPE.fingerprint()} {name}")


def repetitions(dataset: Dataset, first: int, last: int, excluded: tuple[str, ...] = ()) -> Dataset:
    """Return the recordings of some repetitions."""
    kept = tuple(
        e for e in dataset.entries if first <= (e.repetition or 0) <= last and e.surface not in excluded
    )
    return replace(dataset, entries=kept, input_hash=f"{dataset.input_hash} {first}-{last} {excluded}")


class Asked:
    """Model, with features of reference and test recordings from other sensors."""

    def __init__(self, name: str, pipeline: str, trained: Dataset, blocks: tuple[int, int, int, int]) -> None:
        first, last, self.until_references, self.until_tests = blocks
        self.name, self.pipeline = name, load_pipeline(pipeline)
        drawn = np.random.default_rng(SEED).permutation(len(trained.surfaces))[:N_STRANGERS]
        self.strangers = tuple(trained.surfaces[i] for i in drawn)
        self.model: Model = train(
            repetitions(trained, first, last, self.strangers),
            pipeline,
            row="All",
            classifier=PIPELINES[pipeline],
        )
        self.last = last

    def features(self, changed_dataset: Dataset) -> pd.DataFrame:
        """Return metadata and the model's columns of references and tests."""
        wanted = repetitions(
            changed_dataset, self.until_references - (10 if "bio" in self.name else 5) + 1, 10**6
        )
        frame = cached_table(wanted, *self.pipeline.needed, channels=self.pipeline.channels).frame
        return frame.reset_index(drop=True)

    def parts(self, frame: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return reference rows (known surfaces) and test rows (also unknown surfaces)."""
        is_test = frame["repetition"] > self.until_references
        return frame[~is_test & ~frame["surface"].isin(self.strangers)], frame[is_test]

    def values(self, frame: pd.DataFrame) -> Samples:
        """Return the model's columns."""
        return frame[list(self.model.columns)].to_numpy(dtype=np.float64)

    def said(self, model: Model, tests: pd.DataFrame) -> pd.DataFrame:
        """Return for each test row whether it is correct, predicted as unknown, and an unknown surface."""
        p, p_known = model.classify(self.values(tests))
        surface = tests["surface"].to_numpy(dtype=str)
        return pd.DataFrame({
            "surface": surface,
            "right": np.array(model.surfaces)[p.argmax(axis=1)] == surface,
            "unknown": p_known <= model.novelty.false_alarms,
            "stranger": np.isin(surface, self.strangers),
        })  # fmt: skip

    def adapted(self, references: pd.DataFrame, *, labelled: bool) -> Model:
        """Return the model adapted to these rows, or the original if they are rejected."""
        surface = references["surface"].to_numpy(dtype=str)
        known = (surface[:, None] == np.array(self.model.surfaces)) * float(labelled)
        try:
            return adapt_to_rows(self.model, self.values(references), known, np.arange(len(references)), {})
        except ValueError as error:
            print(f"{self.name}: {error}", flush=True)
            return self.model


def drawn_references(way: str, references: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Return the references of one draw."""
    if way == "unlabelled":
        return references
    if way == "20 unlabelled":
        return references.sample(20, random_state=rng)
    n_surfaces = 5 if way.endswith("5") else 3
    names = rng.choice(np.unique(references["surface"]), n_surfaces, replace=False)
    of_these = references[references["surface"].isin(names)]
    n_each = {"3 surfaces": 1, "3 surfaces x 3": 3}.get(way)
    return of_these if n_each is None else of_these.groupby("surface").sample(n_each, random_state=rng)


def ask(
    experiment: Asked, change: str, changed_dataset: Dataset, same: pd.DataFrame, n_draws: int
) -> list[dict[str, Any]]:
    """Return the loss of accuracy by a change, and the recovery by each method."""
    references, tests = experiment.parts(experiment.features(changed_dataset))
    unadapted, found = experiment.said(experiment.model, tests), []
    for way in WAYS:
        rng = np.random.default_rng(SEED)
        said = []
        for _ in range(1 if way == "unlabelled" else n_draws):
            rows = drawn_references(way, references, rng)
            said.append(experiment.said(experiment.adapted(rows, labelled=way.startswith("3")), tests))
        after = pd.concat(said)
        found.append(
            {"felt": experiment.name, "pipeline": experiment.pipeline.name, "change": change, "way": way}
            | figures(same, unadapted, after)
            | {"least": min(one.loc[~one["stranger"], "right"].mean() for one in said), "n_draws": len(said)}
        )
    return found


def figures(same: pd.DataFrame, unadapted: pd.DataFrame, after: pd.DataFrame) -> dict[str, float]:
    """Return accuracies, the share of the loss that is recovered (95 %, bootstrap of surfaces), alarms."""
    known = [said[~said["stranger"]].groupby("surface")["right"].mean() for said in (same, unadapted, after)]
    rates = np.array(known)
    drawn = np.random.default_rng(SEED).integers(rates.shape[1], size=(2000, rates.shape[1]))
    a, b, c = rates[:, drawn].mean(axis=2)
    loss = a - b
    share = (c - b)[loss > 0] / loss[loss > 0]
    low, high = np.quantile(share, [0.025, 0.975]) if share.size else (np.nan, np.nan)
    mean_same, mean_before, mean_after = rates.mean(axis=1)
    loss_of_accuracy = mean_same - mean_before
    alarms = {
        f"{kind}_{when}": float(said.loc[said["stranger"] == (kind == "flagged"), "unknown"].mean())
        for kind in ("alarms", "flagged")
        for when, said in (("same", same), ("before", unadapted), ("after", after))
    }
    return {
        "same": mean_same, "before": mean_before, "after": mean_after, "loss": loss_of_accuracy,
        "recovered": (mean_after - mean_before) / loss_of_accuracy if loss_of_accuracy > 0 else np.nan,
        "low": low, "high": high,
        **alarms,
    }  # fmt: skip


def main() -> None:
    args = command_line(__doc__, draws=10, pipelines="surfaces")
    bio, results = open_dataset("biotac20"), []
    settings = {
        "seed": SEED,
        "input_hash": {"biotac20": bio.input_hash, "simulated": RECIPE.fingerprint()},
        "n_strangers": N_STRANGERS,
    }
    for pipeline in args.pipelines.split(","):
        for name, changes, blocks, felt_with in (
            ("biotac20", CHANGES, (1, 20, 30, 40), partial(changed, bio)),
            ("biotac20, later", {"none": CHANGES["none"]}, (1, 10, 30, 40), partial(changed, bio)),
            ("simulated", TOOLS, (1, 10, 15, 20), simulated),
        ):
            experiment = Asked(name, pipeline, felt_with("none"), blocks)
            base = experiment.features(felt_with("none"))
            same = experiment.said(experiment.model, experiment.parts(base)[1])
            for change in changes:
                results += ask(experiment, change, felt_with(change), same, args.draws)
                last = pd.DataFrame(results[-len(WAYS) :])
                print(last[["felt", "pipeline", "change", "way", "same", "before", "after"]], flush=True)
            report(results, settings, args.out)


def report(results: list[dict[str, Any]], settings: dict[str, Any], out: Any) -> None:
    """Write what has been found so far."""
    blocks: list[Any] = [
        "A model is trained with one sensor and asked with another, before and after `texclass adapt`: an "
        "affine map of each feature, from references felt with the new sensor. `biotac20`: repetitions 1-20 "
        "train, references are of 21-30, 31-40 test, so that the sensor is also older. `simulated`: 24 "
        "surfaces, 20 recordings of each; 1-10 train, references are of 11-15, 16-20 test. Two surfaces are "
        "neither trained nor among the references: strangers. Accuracy of all others; ways that draw are "
        "averaged over their draws, and the worst draw stands beside. Recovered: the share of the loss, 95 % "
        "interval from a bootstrap over surfaces (tests and draws stay with theirs). Alarms: known surfaces "
        f"called unknown, at a setting of 5 %; flagged: strangers called so. The aim is {AIM:.0%} of a loss "
        f"of {WORTH:.0%} or more.",
        Heading("Ways"),
        WAYS,
    ]
    columns = (
        "change = {change} | way = {way} | same sensor = {same:.1%} | before = {before:.1%} | "
        "after = {after:.1%} | worst draw = {least:.1%} | recovered = {told} | "
        "alarms before = {alarms_before:.1%} | alarms after = {alarms_after:.1%} | "
        "flagged before = {flagged_before:.1%} | flagged after = {flagged_after:.1%}"
    )
    frame = pd.DataFrame(results)
    frame["told"] = [
        f"{100 * r.recovered:.0f} % [{100 * r.low:.0f}, {100 * r.high:.0f}]"
        if r.loss >= WORTH
        else "little lost"
        for r in frame.itertuples()
    ]
    for (changed_dataset, pipeline), rows in frame.groupby(["felt", "pipeline"], sort=False):
        blocks += [
            Heading(f"{str(changed_dataset).capitalize()}, {pipeline} ({PIPELINES[pipeline]})"),
            table(rows, columns, n_words=2),
        ]
    meanings = {
        **{f"{k} (biotac20)": v[0] for k, v in CHANGES.items()},
        **{f"{k} (simulated)": v[0] for k, v in TOOLS.items()},
    }
    blocks += [Heading("Changes"), meanings]
    write(out, "sensor_adaptation", settings | {"results": results}, "Adaptation to another sensor", blocks)


if __name__ == "__main__":
    main()
