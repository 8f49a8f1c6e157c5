"""Model cards and predictions as documents."""

from collections.abc import Mapping, Sequence
from typing import Any

from texclass.recognition.answers import Answer
from texclass.recognition.conformal import told
from texclass.recognition.model import Model
from texclass.recognition.model_files import Manifest
from texclass.reporting import Document, Table
from texclass.reporting.wording import counted


def model_document(model: Model) -> Document:
    """Return the facts of a model: surfaces, features, accuracy, calibration, cost, versions."""
    m, by_sklearn = model.manifest, ", ".join(model.estimators)
    on, left_out = m.trained_on, ""
    felt = counted(on["n_recordings"], "recording")
    if m.window_s is not None:
        felt += f", {on['n_windows']} windows of {m.window_s:g} s"
    if "without_graph" in m.accuracy:  # features that an exportable model leaves out
        left_out = (
            f"{', '.join(m.accuracy['without_graph'])}: no graph for ONNX; with them, accuracy "
            f" {100 * m.accuracy['with_all_features']:.1f} %"
        )
    facts = {
        "Surfaces": f"{len(m.surfaces)}: {', '.join(m.surfaces)}",
        "Trained on": f"{on['name']}, {felt} ({on['hash'][:12]})",
        "Adapted to": adapted_facts(m) if m.adapted else "",
        "Pipeline": _pipeline(m),
        "Features": f"{counted(len(model.columns), 'column')} of {', '.join(m.features)}",
        "Left out": left_out,
        "Recordings": _recordings(m),
        "Accuracy": _promise(m.accuracy),
        "Held out": _held_out(m),
        "Not evaluated": "; ".join(m.accuracy.get("untold", ())) or "nothing that the recordings state",
        "Probabilities": _probabilities(m.calibration),
        "Prediction sets": _of_sets(model),
        "Unknown surfaces": _unknown(m),
        "Cost": _cost(m.cost),
        "Stored as": f"scikit-learn estimators: {by_sklearn}" if by_sklearn else "arrays",
        "Versions": ", ".join(f"{name} {version}" for name, version in m.versions.items()),
        "Format": str(m.format_version),
    }
    shown = {name: fact for name, fact in facts.items() if fact}
    return Document(f"Model of {counted(len(m.surfaces), 'surface')}", [shown])


def _pipeline(m: Manifest) -> str:
    """Return row and classifier, the number of candidates, and the budget."""
    of = m.pipeline
    best_of = f", best of {m.accuracy['n_candidates']}" if m.accuracy["n_candidates"] > 1 else ""
    few = f"; {of['few']}: too few to select on, thresholds are wider" if "few" in of else ""
    within = f"; within {of['budget']}" if "budget" in of else ""
    return f"{of['name']}: {of['row']} with {of['classifier']}{best_of}{few}{within}"


def _recordings(m: Manifest) -> str:
    """Return the recordings that the model accepts."""
    felt = f", movements of at least about {m.shortest_s:.2g} s" if m.shortest_s is not None else ""
    if m.window_s is not None:
        felt = f", windows of {m.window_s:g} s"
    return f"{', '.join(m.phases)}; {m.fs:g} Hz, {m.unit}{felt}"


def _promise(accuracy: Mapping[str, Any]) -> str:
    """Return the accuracy on held-out recordings, and the interval for later ones."""
    if "mean" not in accuracy:  # the model is of one recording of a surface
        return "not evaluated: no recording could be held out"
    low, mean, high = (f"{100 * accuracy[name]:.1f}" for name in ("low", "mean", "high"))
    untold, only = accuracy.get("untold"), ""
    if later := accuracy.get("later"):
        low_later, high_later = 100 * later["low"], 100 * later["high"]
        only = f"; later recordings: {low_later:.0f} to {high_later:.0f} %, from other datasets"
    elif untold and untold[0].startswith("later"):
        only = "; later recordings: not evaluated"
    return f"{mean} % ({low} to {high}) of {accuracy['n_tested']} {accuracy['how']}{only}"


def _held_out(m: Manifest) -> str:
    """Return the protocol, its reason, and the effect of drift."""
    stretch, folds = m.unknown["stretch"], counted(m.accuracy["n_folds"], "fold")
    drift = f"; drift makes distances {stretch:.2g} times as large" * (stretch > 1)
    return f"protocol {m.accuracy['protocol']}, {folds} ({m.accuracy['why']}){drift}"


def _unknown(m: Manifest) -> str:
    """Return the novelty score and its threshold."""
    unknown = m.unknown
    if unknown["threshold"] is None:
        return "not evaluated: too few recordings were held out"
    wide = (
        "; with so few, unknown surfaces are often missed"
        if unknown.get("level", 1) < unknown["false_alarms"]
        else ""
    )
    wide += "; later recordings may be reported as unknown more often" * bool(m.accuracy.get("later"))
    return (
        f"by {unknown['score']}, {100 * unknown['false_alarms']:g} % false alarms, "
        f"threshold {unknown['threshold']:.4g} from {unknown['n']} held out{wide}"
    )


def _cost(cost: Mapping[str, float]) -> str:
    names = ("segmentation", "features", "classifier")
    steps = ", ".join(f"{name} {cost[f'{name}_ms']:.2f}" for name in names)
    return f"{sum(cost.values()):.2f} ms per recording ({steps}) on the machine that trained it"


def adapted_facts(manifest: Manifest) -> str:
    """Return the references of an adapted model, and the size of the map."""
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
    """Return predictions as a table, one row per file, with the reasons below.

    A file is named by its recording if no other file has the same name.
    """
    ids = [answer.recording_id for _, answer in answers]
    named = [(name if ids.count(a.recording_id) > 1 else a.recording_id, a) for name, a in answers]
    sets = [told(a.prediction_sets, len(a.probabilities)) for _, a in named]
    levels = dict.fromkeys(level for one in sets for level in one)
    frame = {
        "Recording": [name for name, _ in named],
        "Surface": [f"unknown (nearest: {a.surface})" if a.unknown else a.surface for _, a in named],
        "Runner-up": [a.runner_up for _, a in named],
        **{f"{level} set": [one.get(level, "") for one in sets] for level in levels},
    }
    n_words = len(frame)
    frame["%"] = [f"{100 * a.probability:.1f}" for _, a in named]
    strange = [i for i, (_, answer) in enumerate(named) if answer.unknown]
    reasons = [f"{name}: {reason}" for name, answer in named for reason in answer.reasons]
    return Document(
        counted(len(named), "recording"), [Table(frame, n_words=n_words, strong=strange), reasons]
    )


def _probabilities(calibration: Mapping[str, Any]) -> str:
    """Return the calibration method and its error."""
    scaling = f"{calibration['method']} scaling, beta {calibration['beta']:.3g}"
    if "expected_error" not in calibration:
        return f"{scaling}; from other datasets"
    of_chance = calibration.get("error_of_chance")
    by_chance = f" ({of_chance:.3f} expected by chance)" if of_chance else ""
    held_out = f"{calibration['expected_error']:.3f} on {calibration['n']} held out"
    return f"{scaling}; expected calibration error {held_out}{by_chance}"


def _of_sets(model: Model) -> str:
    """Return levels and calibration set of the prediction sets."""
    if not model.conformity:
        return "none"
    known, levels = model.conformity["answer"], " and ".join(f"{100 * level:g}" for level in model.levels)
    referred = ", references among them" * ("references" in model.manifest.calibration["prediction_sets"])
    return f"coverage {levels} %, from {known.n:.3g} held-out contacts{referred}" + (
        f"; {few}" if (few := known.too_few(model.levels)) else ""
    )
