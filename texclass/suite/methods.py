"""Methods of the suite: pipelines of texclass, a user's pipeline or feature, and baselines."""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from texclass.baselines import BASELINES, Baseline
from texclass.evaluation.pipeline import DEFAULT_PIPELINE, PipelineDefinition, load_pipeline
from texclass.features import load_feature

PIPELINE_TITLES = {
    DEFAULT_PIPELINE: "texclass (default)",
    "coarse": "texclass, coarse bands",
    "texclass": "texclass, selected subset",
    "strese2015": "Strese et al. 2015, selected subset",
}
"""Titles of the pipelines that are compared by default, beginning with the default of `texclass train`."""
DEFAULT_METHODS = (
    *PIPELINE_TITLES, "mfcc", "bands", "tsfel", "catch22", "minirocket", "multirocket_hydra",
)  # fmt: skip
"""Methods of the suite, in the order of their evaluation: slow ones last."""
OWN = "texclass"
"""Author of the methods that are part of texclass."""


@dataclass(frozen=True)
class Method:
    """Method that is evaluated by the suite.

    Attributes
    ----------
    name
        Name in the table.
    title
        Name in reports.
    author
        Author of the entry.
    pipeline
        Pipeline, or None for a baseline.
    baseline
        Baseline, or None for a pipeline.

    Examples
    --------
    >>> find_method("minirocket").title
    'MiniRocket'
    """

    name: str
    title: str
    author: str = OWN
    pipeline: PipelineDefinition | None = None
    baseline: Baseline | None = None

    @property
    def is_baseline(self) -> bool:
        """Whether another library computes the features."""
        return self.baseline is not None

    @cached_property
    def hash(self) -> str:
        """Digest of the pipeline file and of the code of an added feature, or of the baseline's settings."""
        if self.pipeline is not None:
            return self.pipeline.hash
        settings = f"{self.name} {self.baseline and self.baseline.reference}"
        return hashlib.sha256(settings.encode()).hexdigest()[:16]


def find_method(text: str, author: str = "") -> Method:
    """Return a method.

    Parameters
    ----------
    text : str
        Name of a baseline or of a shipped pipeline, path of a pipeline (TOML), or a feature as
        `file.py:function` or `module:function`. A feature is added to the default pipeline of `train`, so
        that its result can be compared with this pipeline.
    author : str
        Author of a user's pipeline or feature (default: "texclass").

    Raises
    ------
    ValueError
        If there is no such method, or the file is invalid.
    """
    author = author or OWN
    if text in BASELINES:
        return Method(text, BASELINES[text].title, baseline=BASELINES[text])
    if ":" in text and not Path(text).is_file():
        pipeline = _add_to_default(text)
        return Method(pipeline.name, pipeline.name, author, pipeline)
    try:
        pipeline = load_pipeline(text)
    except FileNotFoundError as error:
        raise ValueError(
            f"unknown method {text!r}. Expected a baseline ({', '.join(BASELINES)}), a pipeline or its TOML "
            f"file, or a feature (file.py:function). {error}"
        ) from None
    title = PIPELINE_TITLES.get(pipeline.name, pipeline.name)
    return Method(pipeline.name, title, OWN if text in PIPELINE_TITLES else author, pipeline)


def _add_to_default(feature: str) -> PipelineDefinition:
    """Return the default pipeline with a new feature in each of its rows."""
    base = load_pipeline(DEFAULT_PIPELINE)
    extended = base.with_feature(load_feature(feature))
    name = extended.additions[0].name
    rows = tuple(row.model_copy(update={"features": (*row.features, name)}) for row in base.rows)
    # The copy keeps the hash, and the separate table of the new feature in the cache.
    return extended.model_copy(update={"rows": rows, "additions": ()})
