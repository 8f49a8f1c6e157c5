"""Write HTML pages on which users correct the phases of a recording, and copy the saved phases next to it."""

import base64
import json
import shlex
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from texclass.atomic_write import write_atomic
from texclass.evaluation.result_facts import main_direction
from texclass.loaders.phases_files import PhasesFile, file_name, find_phases_file, phases_path
from texclass.phases import find_phases
from texclass.recording import AUXILIARY_UNITS, Recording, RecordingError, Samples
from texclass.reporting.page import templates

MAX_VALUES = 400_000
"""Largest number of values per trace of a page, 1.1 MB: every sample of 40 s at 10 kHz. A page contains the
minima and maxima of blocks of longer signals."""
TRACES = ("friction", "normal_force", "speed", "sound")
"""Auxiliary signals that a page can show under the acceleration; the first two that exist are shown."""
FACTS = ("surface", "duration", "acceleration", "flags")
"""Facts about the recording at the top of a page."""
SCRIPTS = ("envelope", "phases")
LANES = [("taps", "Taps"), ("movement", "Movement"), ("surfaces", "Surfaces")]
KEYS = [
    ("Tab", "select the next interval"),
    (
        "← →",
        "move the selected interval, or the cursor in the signal, by one step (1/500 of the visible part)",
    ),
    ("Shift + ← →", "move by ten steps"),
    ("Alt + ← →", "move the end of the selected interval"),
    ("Enter", "change what the arrow keys move: whole interval, start, contact, end"),
    ("Delete", "delete the selected interval"),
    ("T, M, S", "add a tap, a movement or a surface at the cursor"),
    ("Z", "zoom to the selected interval"),
    ("+, −, 0", "zoom in, zoom out, show all"),
    ("Ctrl + Z, Ctrl + Y", "undo, redo"),
    ("Ctrl + S", "save"),
    ("Escape", "cancel a drag"),
]


def phases_page(recording: Recording, *, command: str = "") -> str:
    """Return a self-contained HTML page on which users correct the phases of a recording.

    The page starts with the phases file of the recording or, if there is none, with the detected phases. It
    saves a phases file, see `PhasesFile`.

    Parameters
    ----------
    recording : Recording
        Whole recording, loaded from a file.
    command : str
        Command that loads the recording, to which the page appends `--phases FILE`.

    Returns
    -------
    str
        The page.

    Raises
    ------
    RecordingError
        If the recording was not loaded from a file, or the phases file of another recording has its name.
    """
    path = recording_file(recording)
    content = find_phases_file(path)
    if content is None:
        if phases_path(path).exists():
            other = PhasesFile.read(phases_path(path)).recording
            raise RecordingError(
                f"{phases_path(path)} contains the phases of {other}, but {path.name} has the same name. "
                "Expected different names: rename one of the recordings"
            )
        content = PhasesFile.from_phases(find_phases(recording), recording, path)
    names = ["acceleration", *[name for name in TRACES if getattr(recording, name) is not None][:2]]
    # The page counts samples of this recording, which may be resampled.
    shown = content.model_copy(update={"fs_hz": recording.fs, "duration_s": recording.duration_s})
    data: dict[str, Any] = {
        "title": f"Phases of {content.recording}",
        "content": shown.model_dump(),
        "file_name": phases_path(path).name,
        "path": str(phases_path(path)),
        "command": f"{command or f'texclass inspect {shlex.quote(str(path))}'} --phases",
        "n_samples": recording.n_samples,
        "surfaces": [recording.surface] if recording.surface else [],
        "traces": [_trace(name, recording) for name in names],
    }
    web = files(__package__).joinpath("web")
    css = files("texclass.reporting").joinpath("templates", "page.css"), web.joinpath("phases.css")
    return templates("texclass.evaluation", "web").get_template("phases.html").render(
        title=data["title"],
        recording=content.recording,
        facts="; ".join(text for name, text in recording.facts.items() if name in FACTS).replace("^2", "²"),
        content=shown,
        file_name=phases_path(path).name,
        traces=data["traces"],
        lanes=LANES,
        key_table=KEYS,
        data=Markup(json.dumps(data).replace("<", "\\u003c")),
        scripts={name: Markup(web.joinpath(f"{name}.js").read_text(encoding="utf-8")) for name in SCRIPTS},
        style=Markup("\n".join(style.read_text(encoding="utf-8") for style in css)),
    )  # fmt: skip


def copy_phases(source: Path, recording: Recording) -> Path:
    """Check a phases file that a page saved, and copy it next to its recording.

    Parameters
    ----------
    source : Path
        File saved by the page of `phases_page`.
    recording : Recording
        Whole recording, loaded from a file.

    Returns
    -------
    Path
        Path of the copy.

    Raises
    ------
    RecordingError
        If the file is not valid or belongs to another recording, or the recording was not loaded from a file.
    """
    path = recording_file(recording)
    content = PhasesFile.read(source)
    content.check(recording, path, source)
    content = content.model_copy(update={"recording": file_name(path)})
    write_atomic(phases_path(path), content.to_json())
    return phases_path(path)


def recording_file(recording: Recording) -> Path:
    """Return the file or folder of a recording.

    Raises
    ------
    RecordingError
        If the recording was not loaded from a file of its own.
    """
    path = Path(recording.source)
    if not recording.source or not path.exists():
        raise RecordingError(
            f"{recording.recording_id}: its phases cannot be saved, because it has no file of its own. "
            "Expected a recording in a file"
        )
    return path


def _trace(name: str, recording: Recording) -> dict[str, Any]:
    """Return a signal as 16-bit integers, decimated to minima and maxima of blocks if it is long."""
    is_acceleration = name == "acceleration"
    x: Samples = main_direction(recording) if is_acceleration else getattr(recording, name)
    block = -(-len(x) // MAX_VALUES)
    if block > 1:
        starts = np.arange(0, len(x), 2 * block)
        x = np.concatenate([np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)])
    offset = float(x.min() + x.max()) / 2
    scale = float(np.ptp(x)) / 65_534 or 1.0
    values = np.rint((x - offset) / scale).astype("<i2")
    unit = recording.unit if is_acceleration else AUXILIARY_UNITS[name]
    ratio = 1.0 if is_acceleration else recording.fs / recording.rate_of(name)
    return {
        "name": name.replace("_", " "),
        "unit": unit.replace("^2", "²"),
        "block": ratio * (2 * block if block > 1 else 1),  # samples of the acceleration
        "is_envelope": block > 1,
        "scale": scale,
        "offset": offset,
        "values": base64.b64encode(values.tobytes()).decode(),
    }
