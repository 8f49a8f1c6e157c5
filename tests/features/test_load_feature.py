"""Features loaded from a module or file of the user."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

from texclass.features import list_features, load_feature
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView

SOURCE = '''
import numpy as np
import beside
from texclass.features import Gain, UndefinedFeatureError, feature

@feature(phase="movement", unit="1", reference="test", outputs=("low", "high"), gain=Gain(power=1))
def ends(view, *, share=0.1):
    """Lowest and highest."""
    if view.n_samples < 3:
        raise UndefinedFeatureError("too short")
    return beside.ends(view.samples)

@feature(phase="movement", unit="1", reference="test")
def bare(view, share):
    return share

def plain(view):
    return 1.0
'''


@pytest.fixture(autouse=True)
def own_registry(monkeypatch):
    monkeypatch.setattr("texclass.features.contract._REGISTRY", list_features())
    monkeypatch.setattr(sys, "path", list(sys.path))


@pytest.fixture
def file(tmp_path):
    (tmp_path / "beside.py").write_text("def ends(x):\n    return [x.min(), x.max()]\n")
    path = tmp_path / "mine.py"
    path.write_text(SOURCE)
    return path


def test_a_feature_of_a_file_is_loaded_with_its_declaration(file, monkeypatch):
    monkeypatch.chdir(file.parent)
    feature = load_feature("mine.py:ends")
    assert feature.columns("ends", {}) == ("ends.low", "ends.high")
    assert feature.function(PhaseView(np.arange(4.0), 1.0)) == [0.0, 3.0]
    assert (feature.gain.power, feature.defaults) == (1, {"share": 0.1})


def test_a_new_process_loads_a_pickled_feature_by_its_path(file):
    code = (
        "import pickle, sys\nfeature = pickle.load(sys.stdin.buffer)\n"
        "import numpy as np\nfrom texclass.features.phase_view import PhaseView\n"
        "print(feature.name, feature.function(PhaseView(np.arange(4.0), 1.0))[1])"
    )
    pickled = pickle.dumps(load_feature(f"{file}:ends"))
    process = subprocess.run(
        [sys.executable, "-c", code], input=pickled, capture_output=True, cwd="/", check=True
    )
    assert process.stdout.split() == [b"ends", b"3.0"]


def test_only_an_edited_file_is_loaded_again(file):
    first, second = load_feature(f"{file}:ends"), load_feature(f"{file}:ends")
    assert second.function is first.function
    file.write_text(SOURCE.replace("beside.ends(view.samples)", "[0.0, 7.0]"))
    assert load_feature(f"{file}:ends").function(PhaseView(np.arange(4.0), 1.0)) == [0.0, 7.0]


def test_a_feature_of_an_installed_module_is_loaded():
    assert load_feature("texclass.features.roughness:waviness").name == "waviness"


def test_a_custom_feature_can_be_undefined_with_a_reason(file):
    with pytest.raises(UndefinedFeatureError, match="too short"):
        load_feature(f"{file}:ends").function(PhaseView(np.arange(2.0), 1.0))


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("mine.py", "must be module:function or path/to/file.py:function"),
        ("mine.py:", "must be module:function"),
        ("mine.py:plain", "plain is not decorated. Expected a function decorated with @feature"),
        ("mine.py:np", "mine.py has no function np"),
        ("mine.py:absent", "mine.py has no function absent"),
        ("mine.py:bare", "every parameter must have a default. Add one to share"),
        ("broken.py:x", r"broken.py cannot be imported \(SyntaxError"),
        ("taken.py:waviness", "'waviness' is already defined in texclass.features.roughness"),
        ("no_such_module:x", "no_such_module cannot be imported"),
    ],
)
def test_invalid_features_are_rejected_with_a_one_line_message(file, monkeypatch, path, message):
    monkeypatch.chdir(file.parent)
    (file.parent / "broken.py").write_text("def x(:\n")
    (file.parent / "taken.py").write_text(SOURCE.replace("def ends", "def waviness"))
    with pytest.raises(ValueError, match=message) as error:
        load_feature(path)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"absent\.py"):
        load_feature(f"{tmp_path}/absent.py:x")
