"""What a model says of itself, and of files, as documents that a terminal, Markdown or a page shows."""

from collections.abc import Mapping, Sequence
from typing import Any

from texclass.document import Document, Table
from texclass.document.wording import counted
from texclass.recognition.answers import Answer
from texclass.recognition.conformal import told
from texclass.recognition.model import Model
from texclass.recognition.model_files import Manifest


def model_document(model: Model) -> Document:
    """Return the facts of a model: surfaces, features, accuracy, calibration, cost, versions."""
    m = model.manifest
    accuracy, calibration, unknown, on = m.accuracy, m.calibration, m.unknown, m.trained_on
    windows = f", {on['n_windows']} touches of {m.touch_s:g} s" if m.touch_s is not None else ""
    best_of = f", best of {accuracy['n_candidates']}" if accuracy["n_candidates"] > 1 else ""
    if few := m.pipeline.get("few"):
        best_of += f"; {few}: too few to choose by, margins are wider"
    best_of += f"; within {m.pipeline['budget']}" if "budget" in m.pipeline else ""
    wide = "; so few that strangers often pass" if unknown.get("level", 1) < unknown["false_alarms"] else ""
    untold = accuracy.get("untold", ())
    only = "; later ones: cannot be told" if untold and untold[0].startswith("later") else ""
    if later := accuracy.get("later"):
        only = f"; later ones: {100 * later['low']:.0f} to {100 * later['high']:.0f} %, as in other data sets"
        wide += "; later ones may be called unknown more often"
    felt = f", movements of about {m.shortest_s:.2g} s and more" if m.shortest_s is not None else ""
    if m.touch_s is not None:
        felt = f", touches of {m.touch_s:g} s"
    drift = f"; drift makes distances {unknown['stretch']:.2g} times as large" * (unknown["stretch"] > 1)
    promise = "no promise: nothing could be held out"
    if "mean" in accuracy:  # else the model is of one recording of a surface
        low, mean, high = (f"{100 * accuracy[name]:.1f}" for name in ("low", "mean", "high"))
        promise = f"{mean} % ({low} to {high}) of {accuracy['n_tested']} {accuracy['how']}{only}"
    n_recordings, n_folds = counted(on["n_recordings"], "recording"), counted(accuracy["n_folds"], "fold")
    steps = ", ".join(  # models of 0.2 do not hold the first
        f"{step} {m.cost[f'{step}_ms']:.2f}"
        for step in ("segmentation", "features", "classifier")
        if f"{step}_ms" in m.cost
    )
    exportable = {}
    if "without_graph" in accuracy:
        exportable["Left out"] = (
            f"{', '.join(accuracy['without_graph'])}: no graph for ONNX; with them, the same choice is right "
            f"in {100 * accuracy['with_all_features']:.1f} %"
        )
    facts = {
        "Surfaces": f"{len(m.materials)}: {', '.join(m.materials)}",
        "Trained on": f"{on['name']}, {n_recordings}{windows} ({on['hash'][:12]})",
        **({"Adapted to": adapted_facts(m)} if m.adapted else {}),
        "Pipeline": f"{m.pipeline['name']}: {m.pipeline['row']} with {m.pipeline['classifier']}{best_of}",
        "Features": f"{counted(len(model.columns), 'column')} of {', '.join(m.features)}",
        **exportable,
        "Recordings": f"{', '.join(m.phases)}; {m.fs:g} Hz, {m.unit}{felt}",
        "Accuracy": promise,
        "Held out": f"protocol {accuracy['protocol']}, {n_folds} ({accuracy['why']}){drift}",
        "Cannot be told": "; ".join(untold) or "nothing of what the recordings name",
        "Probabilities": f"{calibration['method']} scaling, beta {calibration['beta']:.3g}; "
        + _of_errors(calibration),
        "Sets": _of_sets(model),
        "Unknown surfaces": f"by {unknown['score']}, {100 * unknown['false_alarms']:g} % false alarms, "
        f"threshold {unknown['threshold']:.4g} from {unknown['n']} held out{wide}"
        if unknown["threshold"] is not None
        else "not judged: too few recordings were held out",
        "Cost": f"{sum(m.cost.values()):.2f} ms a recording ({steps}) on the machine that trained it",
        "Answers": f"by scikit-learn: {', '.join(asked)}"
        if (asked := model.deployed.asked)
        else "from arrays",
        "Versions": ", ".join(f"{name} {version}" for name, version in m.versions.items()),
        "Format": ".".join(map(str, m.format_version)),
    }
    return Document(f"Model of {counted(len(m.materials), 'surface')}", [facts])


def adapted_facts(manifest: Manifest) -> str:
    """Return what an adapted model says of the references that it follows."""
    surfaces = [surface for _, surface in manifest.adapted["references"] if surface is not None]
    n = counted(len(manifest.adapted["references"]), "reference")
    of = f"{len(surfaces)} of {counted(len(set(surfaces)), 'known surface')}" if surfaces else "unlabelled"
    low, median, high = manifest.adapted["scale"]
    return (
        f"{n}, {of} ({manifest.adapted['hash'][:12]}), map {manifest.adapted.get('map', 'affine')}: "
        f"columns scaled by {median:.2g} ({low:.2g} to "
        f"{high:.2g}); threshold of unknown surfaces by {manifest.adapted['threshold_by']}; accuracy and "
        "calibration are those of the training"
    )


def answers_document(answers: Sequence[tuple[str, Answer]]) -> Document:
    """Return the answers for files by name, one a row, and what a user should know of each.

    A file is called by its recording where no other file is of the same.
    """
    ids = [answer.recording_id for _, answer in answers]
    named = [(name if ids.count(a.recording_id) > 1 else a.recording_id, a) for name, a in answers]
    frame = {
        "Recording": [name for name, _ in named],
        "Surface": [f"unknown (nearest: {a.surface})" if a.unknown else a.surface for _, a in named],
        "Runner-up": [a.runner_up for _, a in named],
        **_sets([answer for _, answer in named]),
    }
    n_words = len(frame)
    frame["%"] = [f"{100 * a.probability:.1f}" for _, a in named]
    strange = [i for i, (_, answer) in enumerate(named) if answer.unknown]
    reasons = [f"{name}: {reason}" for name, answer in named for reason in answer.reasons]
    return Document(
        counted(len(named), "recording"), [Table(frame, n_words=n_words, strong=strange), reasons]
    )


def _sets(answers: Sequence[Answer]) -> dict[str, list[str]]:
    """Return a column for each level of the sets of answers; "" where one has none."""
    found = [told(answer.sets, len(answer.probabilities)) for answer in answers]
    levels = dict.fromkeys(level for one in found for level in one)
    return {f"{level} set": [one.get(level, "") for one in found] for level in levels}


def _of_errors(calibration: Mapping[str, Any]) -> str:
    """Return how far the probabilities of a model are from shares of right answers."""
    if "expected_error" not in calibration:
        return "that of other data sets"
    of_chance = calibration.get("error_of_chance")
    return (
        f"expected calibration error {calibration['expected_error']:.3f} on {calibration['n']} held out"
        + f" ({of_chance or 0:.3f} by chance alone)" * bool(of_chance)
    )


def _of_sets(model: Model) -> str:
    """Return on what the sets of a model stand."""
    if not model.conformity:
        return "none; the rule is a model of format 2.3 or later"
    known, levels = model.conformity["answer"], " and ".join(f"{100 * level:g}" for level in model.levels)
    referred = ", references among them" * ("references" in model.manifest.calibration["sets"])
    return f"hold in {levels} % by what {known.n:.3g} contacts tell{referred}" + (
        f"; {few}" if (few := known.too_few(model.levels)) else ""
    )
