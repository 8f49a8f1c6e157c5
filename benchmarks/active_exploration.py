"""Active exploration: seconds to equal accuracy with selected gestures, on simulated surfaces.

`python benchmarks/active_exploration.py` (24 surfaces, two minutes; `--surfaces 69` adds those in six)
writes reports/studies/active_exploration. Every gesture is made on demand, on the surfaces of `simulated`.
Operators 1-6 train a model for each; with operators 7-8 the best of all fixed orders is chosen; 9-12 test.
"""

import itertools
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from study import command_line, table, write

from texclass.evaluation import cached_table, load_pipeline
from texclass.loaders.simulated import open_gestures
from texclass.recognition import Exploration, GestureStatistics, Model, train
from texclass.recording import Samples
from texclass.reporting import Heading
from texclass.simulate import GESTURES, Recipe

SEED = 2015
TRAINED, CHOSEN = 6, 8
"""Operators up to the one train, up to the other choose a fixed order; those after it test."""
N_OPERATORS, N_REPETITIONS, N_TRAINED = 12, 6, 4
"""Repetitions of each gesture by each operator on each surface; so many of them train."""
N_DRAWS, N_STEPS, N_BOOTSTRAP = 3, 12, 1000
CONFIDENCES = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99, 0.995, 0.999, 0.9999)
ASKED = 0.95
ACCURACIES = (0.90, 0.95, 0.97)

Said = dict[tuple[str, str], dict[str, Samples]]
"""Surface, operator -> gesture -> probabilities of its repetitions, shape (n_repetitions, n_surfaces)."""
Policy = Callable[[Exploration, list[str], np.random.Generator], str]
"""What is known, the gestures of which repetitions are left, a generator -> the next gesture."""


def recipe_of(n_surfaces: int) -> Recipe:
    n = N_OPERATORS * N_REPETITIONS
    return Recipe(
        n_surfaces=n_surfaces, n_recordings=n, n_operators=N_OPERATORS, duration_s=6.0, fs=1e4, seed=SEED
    )


def models_and_answers(recipe: Recipe) -> tuple[dict[str, Model], Said, Said]:
    """Train a model for each gesture; return its predictions for calibration and test recordings."""
    pipeline, models = load_pipeline("texclass"), {}
    said: tuple[Said, Said] = ({}, {})
    for gesture in GESTURES:
        whole = open_gestures(recipe, gesture)
        parts: list[list[Any]] = [[], [], []]
        for entry in whole.entries:
            rank, repetition = divmod((entry.repetition or 0) - 1, N_OPERATORS)[::-1]
            part = 0 if rank < TRAINED else 1 if rank < CHOSEN else 2
            if part or repetition < N_TRAINED:
                parts[part].append(entry)
        datasets = [
            replace(whole, entries=tuple(entries), input_hash=f"{whole.input_hash} {k}")
            for k, entries in enumerate(parts)
        ]
        model = train(
            datasets[0],
            row="Taps" if gesture == "tap" else "Several time scales",
            classifier="lda",
            protocol="operator",
        )
        models[gesture] = model
        for dataset, answers in zip(datasets[1:], said, strict=True):
            features = cached_table(dataset, *pipeline.needed, channels=pipeline.channels)
            p, _ = model.classify(features.frame[list(model.columns)].to_numpy(float))
            for (surface, operator), rows in features.frame.groupby(["surface", "operator"]).indices.items():
                answers.setdefault((surface, operator), {})[gesture] = p[rows]
        print(gesture, len(features.frame), flush=True)
    return models, *said


def felt(
    gestures: dict[str, GestureStatistics], said: Said, policy: Policy, n_draws: int = N_DRAWS
) -> Iterator[dict[str, Any]]:
    """Explore every surface by every operator; yield the state of the exploration after each gesture."""
    surfaces = tuple(sorted({surface for surface, _ in said}))
    for i, ((surface, operator), answers) in enumerate(said.items()):
        for draw in range(n_draws):
            rng = np.random.default_rng((SEED, i, draw))
            remaining = {name: [*rng.permutation(p)] for name, p in answers.items() if name in gestures}
            statistics, seconds = Exploration(surfaces, gestures), 0.0
            for step in range(N_STEPS):
                available = [name for name, group in remaining.items() if group]
                if not available or (name := policy(statistics, available, rng)) not in available:
                    break
                statistics.add(name, dict(zip(surfaces, remaining[name].pop(), strict=True)))
                seconds += gestures[name].seconds
                p = statistics.probabilities
                yield {
                    "surface": surface,
                    "operator": operator,
                    "exploration": f"{i}.{draw}",
                    "n": step + 1,
                    "seconds": seconds,
                    "p": p.max(),
                    "right": surfaces[int(p.argmax())] == surface,
                }


def adaptive(statistics: Exploration, available: list[str], rng: np.random.Generator) -> str:
    return statistics.best_gesture(available)


def at_random(statistics: Exploration, available: list[str], rng: np.random.Generator) -> str:
    return str(rng.choice(available))


def in_order(order: tuple[str, ...]) -> Policy:
    """Make the gestures of an order, one after the other, again and again."""
    return lambda statistics, available, rng: order[statistics.n_gestures % len(order)]


def stopped(steps: pd.DataFrame, confidence: float) -> pd.DataFrame:
    """Return the step of each exploration at which it is sure, or its last."""
    over = steps["p"].ge(confidence) | ~steps["exploration"].duplicated(keep="last")
    return steps[over].drop_duplicates("exploration")


def curve(ends: pd.DataFrame, weights: Samples | None = None) -> tuple[Samples, Samples]:
    """Return mean accuracy and mean seconds at each confidence (a column), each exploration weighted."""
    w = np.ones(len(ends)) if weights is None else weights
    return tuple(w @ ends[what].to_numpy(dtype=float) / w.sum() for what in ("right", "seconds"))


def seconds_to(accuracy: float, reached: tuple[Samples, Samples]) -> float:
    """Return the mean seconds at which a curve of growing confidence first has an accuracy; NaN for never."""
    right, seconds = np.maximum.accumulate(reached[0]), reached[1]
    first = int(np.argmax(right >= accuracy))
    if right[first] < accuracy:
        return np.nan
    return float(np.interp(accuracy, right[: first + 1], seconds[: first + 1]))


def side_by_side(found: dict[Any, pd.DataFrame]) -> pd.DataFrame:
    """Return where explorations ended (rows): right, seconds, n, each by the keys of `found`."""
    ends = {key: one.set_index("exploration")[["right", "seconds", "n"]] for key, one in found.items()}
    return pd.concat(ends, axis=1).swaplevel(axis=1)


def ends_of(steps: pd.DataFrame) -> pd.DataFrame:
    """Return where explorations end that stop at each confidence."""
    return side_by_side({confidence: stopped(steps, confidence) for confidence in CONFIDENCES})


def never_stopped(steps: pd.DataFrame) -> pd.DataFrame:
    """Return where explorations end that all make equally many gestures, by their number."""
    by_number = dict([*steps.groupby("n")])
    return side_by_side({n: one for n, one in by_number.items() if len(one) == len(by_number[1])})


def study(n_surfaces: int) -> dict[str, Any]:
    """Return the seconds to equal accuracy of every policy for a number of surfaces."""
    models, choosing, testing = models_and_answers(recipe_of(n_surfaces))
    gestures = {name: GestureStatistics.from_model(model) for name, model in models.items()}
    to_choose = {
        order: curve(ends_of(pd.DataFrame(felt(gestures, choosing, in_order(order), 1))))
        for order in itertools.permutations(gestures)
    }
    worst = max(seconds[-1] for _, seconds in to_choose.values())
    best = {
        a: min(to_choose, key=lambda o, a=a: np.nan_to_num(seconds_to(a, to_choose[o]), nan=worst))
        for a in (*ACCURACIES, ASKED)
    }
    forgetful = {name: statistics._replace(correlation=0.0) for name, statistics in gestures.items()}
    once: dict[str, tuple[dict[str, GestureStatistics], Policy]] = {
        "adaptive": (gestures, adaptive),
        **{f"fixed, best of 24 at {a:.0%}": (gestures, in_order(best[a])) for a in ACCURACIES},
        "fixed, as recorded": (gestures, in_order(tuple(GESTURES))),
        "random": (gestures, at_random),
        **{f"{name} alone": (gestures, in_order((name,))) for name in gestures},
        "adaptive, repetitions taken as independent": (forgetful, adaptive),
    }
    steps = {
        name: pd.DataFrame(felt(statistics, testing, policy)) for name, (statistics, policy) in once.items()
    }
    ends = {name: ends_of(group) for name, group in steps.items()}
    ends |= {
        f"fixed, best of 24 at {a:.0%}, never stopped early": never_stopped(
            steps[f"fixed, best of 24 at {a:.0%}"]
        )
        for a in ACCURACIES
    }
    where = steps["adaptive"].drop_duplicates("exploration").set_index("exploration")[["surface", "operator"]]
    drawn = [*weights(where)]
    rows = [row(name, found, ends["adaptive"], drawn) for name, found in ends.items()]
    return {
        "n_surfaces": n_surfaces,
        "gestures": {
            name: {
                "seconds": statistics.seconds,
                "correlation": statistics.correlation,
                "accuracy": models[name].manifest.accuracy["mean"],
                "tested": float(
                    np.mean([
                        p[name].argmax(axis=1) == models[name].surfaces.index(surface)
                        for (surface, _), p in testing.items()
                    ])
                ),
            }
            for name, statistics in gestures.items()
        },
        "best_order": {f"{a:.0%}": list(best[a]) for a in ACCURACIES},
        "policies": rows,
        "curves": {name: np.transpose(curve(found)) for name, found in ends.items()},
        "n_explorations": len(where),
    }  # fmt: skip


def weights(where: pd.DataFrame) -> Iterator[Samples]:
    """Yield how often each exploration is drawn where surfaces and operators are, each with replacement."""
    rng = np.random.default_rng(SEED)
    codes = [pd.factorize(where[name])[0] for name in ("surface", "operator")]
    for _ in range(N_BOOTSTRAP):
        times = [
            np.bincount(rng.integers(c.max() + 1, size=c.max() + 1), minlength=c.max() + 1)[c] for c in codes
        ]
        yield (times[0] * times[1]).astype(float)


def row(name: str, ends: pd.DataFrame, ours: pd.DataFrame, drawn: list[Samples]) -> dict[str, Any]:
    """Return seconds to each accuracy and the share of them that `ours` takes, with 95 % intervals."""
    found: dict[str, Any] = {"policy": name}
    mine, theirs = [curve(ours, w) for w in drawn], [curve(ends, w) for w in drawn]
    for a in ACCURACIES:
        seconds, less = seconds_to(a, curve(ends)), seconds_to(a, curve(ours))
        shares = [seconds_to(a, x) / seconds_to(a, y) for x, y in zip(mine, theirs, strict=True)]
        shares = [share for share in shares if np.isfinite(share)]
        bounds = np.quantile(shares, [0.025, 0.975]) if len(shares) > 0.9 * len(drawn) else (np.nan, np.nan)
        gain = {"seconds": seconds, "share": less / seconds, "low": bounds[0], "high": bounds[1]}
        found[f"{a:.2f}"] = {what: float(x) if np.isfinite(x) else None for what, x in gain.items()}
    if ASKED in ends["right"]:
        right = [w @ ends["right"][ASKED].to_numpy(dtype=float) / w.sum() for w in drawn]
        low, high = np.quantile(right, [0.025, 0.975])
        found["stopped"] = {
            "accuracy": float(ends["right"][ASKED].mean()),
            "low": float(low),
            "high": float(high),
            "seconds": float(ends["seconds"][ASKED].mean()),
            "gestures": float(ends["n"][ASKED].mean()),
            "median_gestures": float(ends["n"][ASKED].median()),
        }
    return found


def shown(found: dict[str, Any]) -> dict[str, str]:
    """Return a row of the table."""
    cells = {"policy": found["policy"]}
    for a in ACCURACIES:
        one = found[f"{a:.2f}"]
        range_text = "" if one["low"] is None else f" [{one['low']:.2f}, {one['high']:.2f}]"
        cells[f"s{100 * a:.0f}"] = "-" if one["seconds"] is None else f"{one['seconds']:.2f}"
        cells[f"r{100 * a:.0f}"] = "-" if one["share"] is None else f"{one['share']:.2f}{range_text}"
    stop = found.get("stopped")
    cells["stopped"] = (
        f"{100 * stop['accuracy']:.1f} [{100 * stop['low']:.1f}, {100 * stop['high']:.1f}]" if stop else "-"
    )
    cells["cost"] = (
        f"{stop['seconds']:.2f} s, {stop['gestures']:.1f} ({stop['median_gestures']:.0f})" if stop else "-"
    )
    return cells


def blocks_of(found: dict[str, Any]) -> list[Any]:
    gestures = [{"name": name} | statistics for name, statistics in found["gestures"].items()]
    alike = f"fixed, best of 24 at {ASKED:.0%}"
    comparison = {
        "the order as recorded": "fixed, as recorded",
        "random gestures": "random",
        "the best fixed order where nothing is stopped early": f"{alike}, never stopped early",
        "the best fixed order that stops alike": alike,
    }
    share = {row["policy"]: row[f"{ASKED:.2f}"]["share"] for row in found["policies"]}
    shorter = [
        f"{share[policy]:.2f} of those of {what}" for what, policy in comparison.items() if share[policy]
    ]
    missed = [what for what, policy in comparison.items() if not share[policy]]
    gain = []
    if shorter:
        gain.append(f"To {ASKED:.0%} the adaptive policy takes, of the seconds, {', '.join(shorter)}.")
    if missed:
        gain.append(f"{ASKED:.0%} is not reached by {', '.join(missed)}.")
    orders = "; ".join(f"{a}: {', '.join(order)}" for a, order in found["best_order"].items())
    return [
        Heading(f"{found['n_surfaces']} surfaces"),
        f"{' '.join(gain)} The aim was half.",
        f"{found['n_explorations']} explorations. Best fixed orders, chosen on two operators: {orders}.",
        table(
            gestures,
            "gesture = {name} | seconds = {seconds:.2f} | correlation of repetitions = {correlation:.2f} | "
            "accuracy held out = {accuracy:.1%} | accuracy tested = {tested:.1%}",
        ),
        table(
            map(shown, found["policies"]),
            "policy = {policy} | s to 90 % = {s90} | share = {r90} | s to 95 % = {s95} | share = {r95} | "
            "s to 97 % = {s97} | share = {r97} | right when sure (%) = {stopped} | at = {cost}",
        ),
    ]


def picture(results: list[dict[str, Any]]) -> Any:
    figure, axes = plt.subplots(1, len(results), figsize=(5 * len(results), 3.6), squeeze=False)
    styles = {
        "adaptive": "C0o-",
        "fixed, best of 24 at 95%": "C1s-",
        "fixed, as recorded": "C2^-",
        "random": "C3v-",
        "fixed, best of 24 at 95%, never stopped early": "C1s:",
    }
    for axis, found in zip(axes[0], results, strict=True):
        for name, style in styles.items():
            right, seconds = np.transpose(found["curves"][name])
            axis.plot(seconds, 100 * right, style, markersize=3, label=name)
        axis.set(xlabel="mean seconds", ylabel="right (%)", title=f"{found['n_surfaces']} surfaces")
        axis.set(ylim=(60, 100), xlim=(0, 12))
    axes[0][0].legend(fontsize=7)
    figure.tight_layout()
    return figure


def main() -> None:
    args = command_line(__doc__, surfaces=24)
    file = args.out / "active_exploration.json"
    stored_results = json.loads(file.read_text(encoding="utf-8"))["results"] if file.exists() else []
    found = {one["n_surfaces"]: one for one in stored_results} | {args.surfaces: study(args.surfaces)}
    results = [found[n] for n in sorted(found)]
    settings = {
        "seed": SEED,
        "input_hash": " ".join(recipe_of(found["n_surfaces"]).fingerprint()[:16] for found in results),
    }
    blocks = [
        "A tap, a slow, a fast and a hard stroke, each made on demand on the surfaces of the "
        f"simulated datasets. A model of each was trained on operators 1-{TRAINED} ({N_TRAINED} "
        f"repetitions a surface); operators {CHOSEN + 1}-{N_OPERATORS}, whom no model knows, test. A "
        "policy goes on until the probability of the likeliest surface reaches a confidence, or "
        f"{N_STEPS} gestures were made ({N_REPETITIONS} of one kind at most); each confidence gives a "
        "mean accuracy and a mean of seconds. `s to 90 %` is the mean of seconds at which that "
        "accuracy is reached, interpolated; `share` is what the adaptive policy takes of it. All "
        "policies put answers together alike. The best fixed order is the fastest of all 24 to that "
        f"accuracy with operators {TRAINED + 1}-{CHOSEN}, stopping alike; `as recorded` is tap, slow, "
        "fast, hard stroke, again and again; `never stopped early` gives every surface equally many "
        "gestures. `-`: not reached. 95 % intervals: bootstrap over surfaces and operators. `right "
        f"when sure`: stopped at a confidence of {ASKED}; then the mean of seconds, and mean and "
        "median number of gestures.",
        *itertools.chain.from_iterable(map(blocks_of, results)),
    ]
    write(
        args.out,
        "active_exploration",
        settings | {"results": results},
        "Active exploration",
        blocks,
        picture(results),
    )


if __name__ == "__main__":
    main()
