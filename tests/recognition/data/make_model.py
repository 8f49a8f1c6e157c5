"""Make the model file that later versions of its format must keep loading; it is written beside this script.

Run it again only when the major version of the format is raised.
"""

import json
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

# ruff: noqa: E402
from toy_surfaces import SURFACES, pipeline, recording, surfaces

from texclass.recognition import load_model, train


def main() -> None:
    """Write surface-2.0.skops, and what it says of a recording of each surface."""
    train(surfaces(), pipeline(), row="Spectrum", classifier="lda").save(HERE / "surface-2.0.skops")
    loaded, answers = load_model(HERE / "surface-2.0.skops"), []
    for surface in SURFACES:
        said = loaded.answer(recording(surface, 1000))
        answers.append(
            {"surface": surface, "seed": 1000, "probability": said.probability, "unknown": said.unknown}
        )
    (HERE / "surface-2.0.json").write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
