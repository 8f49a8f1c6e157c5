"""What a model says of itself, and of files, as documents that a terminal, Markdown or a page shows."""

from collections.abc import Sequence

from texclass.document import Document, Table
from texclass.document.wording import counted
from texclass.recognition.model import Answer, Model


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
    felt = f", movements of about {m.shortest_s:.2g} s and more" if m.shortest_s is not None else ""
    if m.touch_s is not None:
        felt = f", touches of {m.touch_s:g} s"
    drift = f"; drift makes distances {unknown['stretch']:.2g} times as large" * (unknown["stretch"] > 1)
    low, mean, high = (f"{100 * accuracy[name]:.1f}" for name in ("low", "mean", "high"))
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
        "Pipeline": f"{m.pipeline['name']}: {m.pipeline['row']} with {m.pipeline['classifier']}{best_of}",
        "Features": f"{counted(len(model.columns), 'column')} of {', '.join(m.features)}",
        **exportable,
        "Recordings": f"{', '.join(m.phases)}; {m.fs:g} Hz, {m.unit}{felt}",
        "Accuracy": f"{mean} % ({low} to {high}) of {accuracy['n_tested']} {accuracy['how']}{only}",
        "Held out": f"protocol {accuracy['protocol']}, {n_folds} ({accuracy['why']}){drift}",
        "Cannot be told": "; ".join(untold) or "nothing of what the recordings name",
        "Probabilities": f"{calibration['method']} scaling, beta {calibration['beta']:.3g}; expected "
        f"calibration error {calibration['expected_error']:.3f} on {calibration['n']} held out"
        + (
            f" ({of_chance:.3f} by chance alone)" if (of_chance := calibration.get("error_of_chance")) else ""
        ),
        "Unknown surfaces": f"by {unknown['score']}, {100 * unknown['false_alarms']:g} % false alarms, "
        f"threshold {unknown['threshold']:.4g} from {unknown['n']} held out{wide}",
        "Cost": f"{sum(m.cost.values()):.2f} ms a recording ({steps}) on the machine that trained it",
        "Answers": f"by scikit-learn: {', '.join(asked)}"
        if (asked := model.deployed.asked)
        else "from arrays",
        "Versions": ", ".join(f"{name} {version}" for name, version in m.versions.items()),
        "Format": ".".join(map(str, m.format_version)),
    }
    return Document(f"Model of {counted(len(m.materials), 'surface')}", [facts])


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
        "%": [f"{100 * a.probability:.1f}" for _, a in named],
    }
    strange = [i for i, (_, answer) in enumerate(named) if answer.unknown]
    reasons = [f"{name}: {reason}" for name, answer in named for reason in answer.reasons]
    return Document(counted(len(named), "recording"), [Table(frame, n_words=3, strong=strange), reasons])
