"""Files in, answers out: a bad file is named and stops nothing."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from texclass.recognition.answer import Answer
from texclass.recognition.model import Model
from texclass.recognition.source import Source, find_like


class Prediction(NamedTuple):
    """What became of one file: an answer, or the problem that there is none."""

    name: str
    answer: Answer | None
    problem: str = ""


def predict(
    model: Model, names: Iterable[str], *, fs: float | None = None, unit: str | None = None
) -> Iterator[Prediction]:
    """Yield what a model says of each file, in their order, as soon as it is known.

    Parameters
    ----------
    model : Model
        Trained on whole recordings, or on touches, into which longer recordings are cut.
    names : iterable of str
        Files, or DATASET:RECORDING.
    fs, unit : optional
        Of files that do not state them; by default those of the training files.
    """
    source = Source.of_dict(model.manifest.input)
    for name in names:
        try:
            recording = find_like(source, name, fs=fs, unit=unit)
            answer = (
                model.answer(recording) if model.manifest.touch_s is None else model.answer_touches(recording)
            )
        except (ValueError, OSError) as error:
            problem = str(error)
            yield Prediction(name, None, problem if name in problem else f"{name}: {problem}")
        else:
            yield Prediction(name, answer)
