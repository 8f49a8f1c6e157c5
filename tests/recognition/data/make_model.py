"""Make the model file of format 1.0 that later versions must keep loading; it is written beside this script.

It was written once and stays as it is; run again only to see how it came about. Format 1.0 had neither the
shortest movement nor answers to a probe.
"""

import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

# ruff: noqa: E402
from toy_surfaces import SURFACES, pipeline, recording, surfaces

from texclass.recognition import TrainingSettings, load_model, train
from texclass.recognition.files import read_model_file, write_model_file


def main() -> None:
    """Write surface-1.0.skops, and what it says of five recordings."""
    path = HERE / "surface-1.0.skops"
    model = train(surfaces(), pipeline(), TrainingSettings("Spectrum", "lda"))
    with tempfile.TemporaryDirectory() as folder:
        model.save(Path(folder) / "new.skops")
        document, manifest = read_model_file(Path(folder) / "new.skops")
    old = {key: value for key, value in document.items() if key != "probe"}
    write_model_file(path, old, replace(manifest, schema=(1, 0), shortest_s=None))
    loaded, answers = load_model(path), []
    for surface in SURFACES:
        said = loaded.answer(recording(surface, 1000))
        answers.append(
            {"surface": surface, "seed": 1000, "probability": said.probability, "unknown": said.unknown}
        )
    (HERE / "surface-1.0.json").write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
