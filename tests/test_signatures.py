"""Public functions list their keyword arguments, so that help shows them and a mistyped one is an error."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

import texclass as tx
from texclass.haptics import scene, textures

ROOT = Path(tx.__file__).parent
# The changes are fields of the dataclass, as in `dataclasses.replace`, which rejects others.
EXCEPTIONS = {"Recording.with_"}


def public_callables():
    """Return the functions, classes and methods that the indexes of all subpackages offer, by name."""
    callables = {}
    for index in ROOT.rglob("__init__.pyi"):
        module = importlib.import_module(".".join(index.parent.relative_to(ROOT.parent).parts))
        for name in re.findall(r" as (\w+)", index.read_text(encoding="utf-8")):
            one = getattr(module, name)
            if callable(one) and (getattr(one, "__module__", None) or "").startswith("texclass"):
                callables[name] = one
            if inspect.isclass(one):
                methods = inspect.getmembers(one, inspect.isroutine)
                callables |= {
                    f"{name}.{method}": function
                    for method, function in methods
                    if not method.startswith("_")
                    and (getattr(function, "__module__", None) or "").startswith("texclass")
                }
    return callables


def test_no_public_callable_takes_any_keyword():
    callables = public_callables()
    assert len(callables) > 200
    assert {"open_dataset", "Model.predict", "fit_texture", "write_slider_page"} <= set(callables)
    open_ended = set()
    for name, one in callables.items():
        if inspect.isclass(one) and issubclass(one, str | Exception):
            continue  # without a signature
        if getattr(one, "_is_protocol", False):
            continue
        parameters = inspect.signature(one).parameters.values()
        if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
            open_ended.add(name)
    assert open_ended == EXCEPTIONS


@pytest.mark.parametrize(
    "call",
    [
        tx.open_dataset,
        tx.benchmark,
        tx.load_recording,
        tx.score_stream,
        tx.haptics.describe,
        tx.loaders.draft_card,
        tx.loaders.find_recording,
        tx.recognition.open_source,
        tx.recognition.predict,
        tx.recognition.Model.predict,
        tx.recognition.Model.predict_set,
        tx.evaluation.study_feature,
        tx.evaluation.evaluate,
        scene.write_slider_page,
        textures.abdulali2016.fit_texture,
    ],
    ids=lambda one: one.__qualname__,
)
def test_a_mistyped_keyword_names_the_function(call):
    required = [
        None
        for one in inspect.signature(call).parameters.values()
        if one.default is one.empty and one.kind is not one.KEYWORD_ONLY
    ]
    with pytest.raises(TypeError, match=rf"{call.__name__}\(\) got an unexpected keyword argument 'no_such'"):
        # A generator function, too, checks its arguments when it is called.
        call(*required, no_such=1)


def test_every_parameter_of_a_public_function_is_documented():
    for name, one in public_callables().items():
        if inspect.isfunction(one) and one.__doc__ and "Parameters\n" in one.__doc__:
            section = inspect.getdoc(one).split("Parameters\n")[1].split("\n\nReturns\n")[0]
            documented = set(
                re.findall(r"[\w]+", " ".join(re.findall(r"(?m)^(\*{0,2}\w[^:\n]*)(?: :|$)", section)))
            )
            parameters = set(inspect.signature(one).parameters) - {"self", "cls"}
            assert parameters <= documented, (name, parameters - documented)
