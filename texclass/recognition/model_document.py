"""Create model cards, and tables of predictions, as documents."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from texclass.recognition.answers import Answer
from texclass.recognition.contact_check import MIN_LEVEL
from texclass.recognition.model import Model
from texclass.recognition.model_files import LATER_RECORDINGS, Manifest
from texclass.recognition.prediction_sets import describe_sets
from texclass.recording import describe_axes
from texclass.reporting import Document, Table
from texclass.reporting.wording import counted

SHOWN_FACTS = (
    "Surfaces",
    "Trained on",
    "Adapted to",
    "Pipeline",
    "Features",
    "Recordings",
    "Accuracy",
    "Probabilities",
    "Prediction sets",
    "Versions",
)
"""Facts of the model card that a notebook shows at once."""


def model_document(model: Model) -> Document:
    """Return the model card: surfaces, features, accuracy, calibration, cost, versions.

    Parameters
    ----------
    model : Model
        Trained or adapted model.

    Examples
    --------
    >>> print(model_document(model))  # doctest: +SKIP
    """
    m, estimators = model.manifest, ", ".join(model.estimators)
    rows = {
        "Surfaces": f"{len(m.surfaces)}: {', '.join(m.surfaces)}",
        "Trained on": _training_set(m),
        "Adapted to": describe_adaptation(m) if m.adapted else "",
        "Pipeline": _pipeline(m),
        "Features": f"{counted(len(model.columns), 'column')} of {', '.join(m.features)}",
        "Axes": m.pipeline.get("axes", ""),
        "Left out": _not_exportable(m.accuracy),
        "Recordings": _recordings(m),
        "Accuracy": _accuracy(m.accuracy),
        "Held out": _held_out(m),
        "Not evaluated": "; ".join(m.accuracy.get("not_evaluated", ()))
        or "none of the conditions that the recordings state",
        "Probabilities": _probabilities(m),
        "Prediction sets": _prediction_sets(model),
        "Unknown surfaces": _unknown(m),
        "No contact": _contact(m),
        "Cost": _cost(m.cost),
        "Stored as": f"scikit-learn estimators: {estimators}" if estimators else "arrays",
        "Versions": ", ".join(f"{name} {version}" for name, version in m.versions.items()),
        "Format": str(m.format_version),
    }
    return Document(
        f"Model of {counted(len(m.surfaces), 'surface')}",
        [{name: text for name, text in rows.items() if text}],
    )


def model_html(model: Model) -> str:
    """Return the model card as HTML for notebooks: the most important facts, then the others on request.

    Parameters
    ----------
    model : Model
        Trained or adapted model.
    """
    document = model_document(model)
    facts = next(block for block in document.blocks if isinstance(block, Mapping))
    tables = {True: "", False: ""}
    for name, text in facts.items():
        cells = f'<th style="text-align: left">{escape(name)}</th><td style="text-align: left">{escape(text)}'
        tables[name in SHOWN_FACTS] += f'<tr style="vertical-align: top">{cells}</td></tr>'
    return (
        f"<p><strong>{escape(document.title)}</strong></p><table>{tables[True]}</table>"
        f"<details><summary>Further facts</summary><table>{tables[False]}</table></details>"
    )


def _training_set(m: Manifest) -> str:
    data = m.trained_on
    windows = "" if m.window_s is None else f", {data['n_windows']} windows of {m.window_s:g} s"
    return f"{data['name']}, {counted(data['n_recordings'], 'recording')}{windows} ({data['hash'][:12]})"


def _not_exportable(accuracy: Mapping[str, Any]) -> str:
    if "not_exportable" not in accuracy:
        return ""
    names = ", ".join(accuracy["not_exportable"])
    accuracy_with_all = f"{100 * accuracy['with_all_features']:.1f} %"
    return f"{names}, which cannot be exported to ONNX; accuracy with these features: {accuracy_with_all}"


def _pipeline(m: Manifest) -> str:
    """Return the row, the classifier, the number of candidates and the budget."""
    pipeline = m.pipeline
    selection = f", best of {m.accuracy['n_candidates']} pairs" if m.accuracy["n_candidates"] > 1 else ""
    shortage = ""
    if "shortage" in pipeline:
        shortage = f"; {pipeline['shortage']}: too few to select row and classifier, and thresholds are wider"
    budget = f"; within {pipeline['budget']}" if "budget" in pipeline else ""
    return f"{pipeline['name']}: {pipeline['row']} with {pipeline['classifier']}{selection}{shortage}{budget}"


def _recordings(m: Manifest) -> str:
    """Return the phases, sampling rate, unit, axes and length of the recordings that the model accepts."""
    length = f", movements of at least about {m.shortest_s:.2g} s" if m.shortest_s is not None else ""
    if m.window_s is not None:
        length = f", windows of {m.window_s:g} s"
    axes = f", {describe_axes(m.input.axes)}" if m.input.axes else ""
    others = "".join(f", {name} at {rate:g} Hz" for name, rate in m.auxiliary_fs.items())
    return f"{', '.join(m.phases)}; {m.fs:g} Hz, {m.unit}{axes}{others}{length}"


def _accuracy(accuracy: Mapping[str, Any]) -> str:
    """Return the accuracy on held-out recordings, and the interval for later recordings."""
    if "mean" not in accuracy:
        return "not evaluated: no recording could be held out"
    low, mean, high = (f"{100 * accuracy[name]:.1f}" for name in ("low", "mean", "high"))
    conditions, addition = accuracy.get("not_evaluated"), ""
    if later := accuracy.get("later_recordings"):
        later_low, later_high = 100 * later["low"], 100 * later["high"]
        sources = {
            "halves": "between the earlier and the later half",
            "other datasets": "from other datasets",
        }
        addition = (
            f"; expected for later recordings: {later_low:.0f} to {later_high:.0f} % "
            f"({sources[later['source']]})"
        )
    elif conditions and conditions[0].startswith(LATER_RECORDINGS):
        addition = "; later recordings: not evaluated"
    return f"{mean} % ({low} to {high}) of {accuracy['n_tested']} {accuracy['description']}{addition}"


def _held_out(m: Manifest) -> str:
    """Return the protocol, the reason for it, and the effect of drift."""
    factor, folds = m.unknown["drift_factor"], counted(m.accuracy["n_folds"], "fold")
    drift = f"; drift multiplies the distances of the novelty score by {factor:.2g}" * (factor > 1)
    return f"protocol {m.accuracy['protocol']}, {folds} ({m.accuracy['reason']}){drift}"


def _unknown(m: Manifest) -> str:
    """Return the novelty score and its threshold."""
    unknown = m.unknown
    if unknown["threshold"] is None:
        return "not evaluated: too few recordings were held out"
    notes = ""
    if unknown.get("p_threshold", 1) < unknown["false_alarms"]:
        notes += "; unknown surfaces are often missed, since there are few held-out recordings"
    if "later_recordings" in m.accuracy and not m.calibration["prediction_sets"]["n_halves"]:
        notes += "; later recordings may be reported as unknown more often"
    return (
        f"novelty score: {unknown['score']}, threshold {unknown['threshold']:.4g} for "
        f"{100 * unknown['false_alarms']:g} % false alarms, from {unknown['n']} held-out {_unit(m)}{notes}"
    )


def _contact(m: Manifest) -> str:
    """Return the level below which a recording has no contact."""
    if not m.contact:
        return ""
    if m.adapted:
        return "unknown, also: white noise; the adapted model does not compare levels"
    return (
        f"unknown, also: vibration levels below {MIN_LEVEL * m.contact['level']:.2g} {m.unit} (trained on "
        f"{m.contact['level']:.2g} and more), and white noise"
    )


def _cost(cost: Mapping[str, float]) -> str:
    names = ("segmentation", "features", "classifier")
    steps = ", ".join(f"{name} {cost[f'{name}_ms']:.2f}" for name in names)
    return f"{sum(cost.values()):.2f} ms per recording ({steps}) on the training machine"


def describe_adaptation(manifest: Manifest) -> str:
    """Describe the references and the feature map of an adapted model.

    Parameters
    ----------
    manifest : Manifest
        Manifest of an adapted model.
    """
    surfaces = [surface for _, surface in manifest.adapted["references"] if surface is not None]
    n_references = counted(len(manifest.adapted["references"]), "reference")
    labels = "unlabelled"
    if surfaces:
        labels = f"{len(surfaces)} labelled, {counted(len(set(surfaces)), 'surface')}"
    adapted = manifest.adapted
    source = f"threshold for unknown surfaces from {adapted['threshold_from']}"
    if "prediction_sets" in manifest.calibration:
        source += f"; prediction sets from {adapted['sets_from']}"
    if not adapted["has_trained_variation"]:
        source += (
            "; trained on one recording per surface: the variation within a surface is from other datasets"
        )
    return (
        f"{n_references}, {labels} ({adapted['hash'][:12]}), map {adapted['map']}: "
        f"{describe_shift(adapted)}; {source}; accuracy and probabilities were measured before the adaptation"
    )


def describe_shift(adapted: Mapping[str, Any]) -> str:
    """Describe by how much an adaptation changes the columns.

    Parameters
    ----------
    adapted : mapping
        Entry `adapted` of a manifest; see `texclass.recognition.adaptation.describe_map`.

    Examples
    --------
    >>> shift = {"n_shifted": 9, "shift": [0.4, 0.8, 1.2], "most_shifted": "fineness"}
    >>> describe_shift({**shift, "scale": [1.0, 1.0, 1.0]})
    '9 columns shifted by 0.4 standard deviations within a surface (median; largest 1.2: fineness)'
    """
    if not adapted["n_shifted"]:
        text = "no column shifted"
    else:
        median, _, largest = adapted["shift"]
        text = (
            f"{counted(adapted['n_shifted'], 'column')} shifted by {median:.2g} standard deviations within a "
            f"surface (median; largest {largest:.2g}: {adapted['most_shifted']})"
        )
    low, median, high = (f"{value:.2g}" for value in adapted["scale"])
    if (low, median, high) == ("1", "1", "1"):
        return text
    return f"{text}, scaled by {median} ({low} to {high})"


def answers_document(answers: Sequence[tuple[str, Answer]]) -> Document:
    """Return predictions as a table with one row per file, followed by the reasons of the answers.

    Parameters
    ----------
    answers : sequence of (str, Answer)
        File and answer. A file is listed by its recording identifier, unless two files have the same one.

    Examples
    --------
    >>> answer = Answer("stroke_1", "oak", 0.9, "cork", unknown=False, p_known=0.4)
    >>> answers_document([("stroke_1.txt", answer)]).blocks[0].frame["Surface"]
    ['oak']
    """
    ids = [answer.recording_id for _, answer in answers]
    rows = [(name if ids.count(a.recording_id) > 1 else a.recording_id, a) for name, a in answers]
    sets = [describe_sets(a.prediction_sets, len(a.probabilities)) for _, a in rows]
    levels = dict.fromkeys(level for one in sets for level in one)
    frame = {
        "Recording": [name for name, _ in rows],
        "Surface": [f"unknown (nearest: {a.surface})" if a.unknown else a.surface for _, a in rows],
        "Runner-up": [a.runner_up for _, a in rows],
        **{f"{level} set": [one.get(level, "") for one in sets] for level in levels},
    }
    n_words = len(frame)
    frame["%"] = [f"{100 * a.probability:.1f}" for _, a in rows]
    unknown = [i for i, (_, answer) in enumerate(rows) if answer.unknown]
    reasons = [f"{name}: {reason}" for name, answer in rows for reason in answer.reasons]
    return Document(
        counted(len(rows), "recording"), [Table(frame, n_words=n_words, bold_rows=unknown), reasons]
    )


def _unit(m: Manifest) -> str:
    return "recordings" if m.window_s is None else "windows"


def _probabilities(m: Manifest) -> str:
    """Return the calibration method and its error."""
    calibration = m.calibration
    method = f"{calibration['method']} scaling, beta {calibration['beta']:.3g}"
    if "expected_error" not in calibration:
        return f"{method}, with beta from other datasets"
    chance = calibration.get("error_by_chance")
    by_chance = f" ({chance:.3f} expected by chance)" if chance else ""
    error = f"{calibration['expected_error']:.3f} on {calibration['n']} held-out {_unit(m)}"
    return f"{method}; expected calibration error {error}{by_chance}"


def _prediction_sets(model: Model) -> str:
    """Return the coverage levels and the calibration set of the prediction sets."""
    if not model.set_calibrations:
        return "none"
    calibration = model.set_calibrations["answer"]
    levels = " and ".join(f"{100 * level:g}" for level in model.levels)
    entry = model.manifest.calibration["prediction_sets"]
    references = ", including references" if "references" in entry else ""
    halves = ", and from the earlier and the later half (worst case)" if entry["n_halves"] else ""
    shift = f", widened by {entry['shift']:g} of log odds (from other datasets)" if entry["shift"] else ""
    notes = [warning] if (warning := calibration.warning(model.levels)) else []
    if "later_coverage" in entry:
        low, high = (100 * share for share in entry["later_coverage"])
        notes.append(
            f"few recordings: in other datasets, 90 % sets contained {low:.0f} to {high:.0f} % of later ones"
        )
    source = f"{calibration.effective_n:.3g} held-out recordings{references}{halves}{shift}"
    return "; ".join([f"coverage {levels} %, from {source}", *notes])
