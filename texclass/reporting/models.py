"""Models and their answers, for a terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from texclass.reporting.terminal import table_of

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

    from texclass.recognition.model import Answer
    from texclass.recognition.model_files import Manifest


def model_table(manifest: "Manifest", n_columns: int) -> "Table":
    """Return what a model says of itself, a fact a row."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column()
    for name, value in _facts(manifest, n_columns):
        table.add_row(name, Text(value))
    return table


def answer_table(found: Sequence[tuple[str, "Answer"]]) -> "Group":
    """Return the answers for files, one a row, and below them what a user should know of each."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    ids = [answer.recording_id for _, answer in found]
    names = [a.recording_id if ids.count(a.recording_id) == 1 else name for name, a in found]
    rows = [
        (name, f"unknown (nearest: {a.surface})" if a.unknown else a.surface, a.runner_up, _percent(a))
        for name, (_, a) in zip(names, found, strict=True)
    ]
    styles = ["yellow" if answer.unknown else "" for _, answer in found]
    table = table_of(("Recording", "Surface", "Runner-up", "%"), rows, styles, n_text=3)
    remarks: list[Any] = [
        line
        for name, (_, answer) in zip(names, found, strict=True)
        if answer.reasons
        for line in (Text(name), *(Padding(Text(reason), (0, 0, 0, 2)) for reason in answer.reasons))
    ]
    return Group(table, *remarks)


def _percent(answer: "Answer") -> str:
    return f"{100 * answer.probability:.1f}"


def _facts(m: "Manifest", n_columns: int) -> list[tuple[str, str]]:
    a, c, u, on = m.accuracy, m.calibration, m.unknown, m.trained_on
    windows = f", {on['n_windows']} touches of {m.touch_s:g} s" if m.touch_s is not None else ""
    candidates = f", best of {a['n_candidates']}" if a["n_candidates"] > 1 else ""
    return [
        ("Surfaces", f"{len(m.materials)}: {', '.join(m.materials)}"),
        ("Trained on", f"{on['name']}, {on['n_recordings']} recordings{windows} ({on['hash'][:12]})"),
        (
            "Pipeline",
            f"{m.pipeline['name']}: {m.pipeline['row']} with {m.pipeline['classifier']}{candidates}",
        ),
        ("Features", f"{n_columns} columns of {', '.join(m.features)}"),
        (
            "Recordings",
            f"{', '.join(m.phases)}; {m.fs:g} Hz, {m.unit}" + (f", {_felt(m)}" if _felt(m) else ""),
        ),
        (
            "Accuracy",
            f"{100 * a['mean']:.1f} % ({100 * a['low']:.1f} to {100 * a['high']:.1f}) of {a['n_tested']} "
            f"{a['how']}",
        ),
        ("Held out", _held_out(m)),
        (
            "Probabilities",
            f"{c['method']} scaling, beta {c['beta']:.3g}; expected calibration error "
            f"{c['expected_error']:.3f} on {c['n']} held out",
        ),
        (
            "Unknown surfaces",
            f"by {u['score']}, {100 * u['false_alarms']:g} % false alarms, threshold {u['threshold']:.4g} "
            f"from {u['n']} held out",
        ),
        ("Cost", f"{m.cost['features_ms']:.2f} ms features, {m.cost['classifier_ms']:.2f} ms classifier"),
        ("Versions", ", ".join(f"{name} {version}" for name, version in m.versions.items())),
        ("Format", ".".join(map(str, m.format_version))),
    ]


def _held_out(m: "Manifest") -> str:
    a, stretch = m.accuracy, m.unknown.get("stretch", 1.0)
    folds = f"{a['n_folds']} fold{'s' * (a['n_folds'] > 1)}"
    why = f" ({a['why']})" if "why" in a else ""  # models of before 1.2 do not say
    drift = f"; drift makes distances {stretch:.2g} times as large" if stretch > 1 else ""
    return f"protocol {a['protocol']}, {folds}{why}{drift}"


def _felt(m: "Manifest") -> str:
    if m.touch_s is not None:
        return f"touches of {m.touch_s:g} s"
    return "" if m.shortest_s is None else f"movements of about {m.shortest_s:.2g} s and more"
