"""Fuzzing targets: cards, feature sets, pipelines, scenes, paths of a hand, and results."""

import json
import tomllib
from pathlib import Path

from fuzz.contract import Target
from fuzz.mutate import json_of, of_text, toml_of, trees
from texclass import shipped
from texclass.cli.result_files import damage_as_value_error, read_document
from texclass.evaluation import load_pipeline
from texclass.features import load_feature_set
from texclass.haptics.scene.definition import EXAMPLES, read_path, read_scene
from texclass.loaders import open_dataset, read_card
from texclass.loaders.filesets import match_name
from texclass.reporting import render_page

_TOML = trees(lambda data: tomllib.loads(data.decode()), toml_of)
_CARD = """title = "Toy"
folder = "toy"
format = "files"
fs_hz = 1000
unit = "g"
scale = 0.5
phases = "movement"
files = ["(?P<surface>[a-z]+)/(?P<repetition>[0-9]+)_(?P<axis>[XYZ]).csv"]
delimiter = ";"
notes = ["made up"]
[channels]
acceleration = ["x", "y", "z"]
[labels]
file = "labels.csv"
recording = "id"
operator = "who"
[companions]
friction = "{surface}/{repetition}_F.csv"
"""
_ROWS = """title = "Toy"
folder = "toy"
format = "rows"
fs_hz = 50
unit = "counts"
phases = "movement"
files = ["X.csv", "Y.csv"]
label_column = "label"
"""
_RECIPE = """title = "Toy"
format = "simulated"
recipe = {n_surfaces = 2, n_recordings = 2, n_operators = 1, duration_s = 1.0, fs = 1000, seed = 1}
"""
_SET = """name = "small"
reference = "x"
[features.mfcc]
coefficients = [1, 2]
[features.again]
use = "fineness"
"""
_PIPELINE = """name = "small"
features = "strese2015"
seed = 1
protocol = {name = "recording", folds = 3}
steps = [{use = "sklearn.preprocessing.StandardScaler"}]
[classifiers]
lda = {use = "sklearn.discriminant_analysis.LinearDiscriminantAnalysis", solver = "lsqr", shrinkage = 0.1}
[[rows]]
name = "All"
features = ["fineness", "temporal_roughness"]
select = {n = 2, folds = 2}
published = {lda = 80.5}
[[additions]]
name = "more"
features = ["hardness"]
"""
_SCENE = """name = "small"
seed = 3
[device]
rate_hz = 1000
band_hz = [20.0, 450.0]
noise_floor = 0.01
largest_output = 20
unit = "m/s^2"
[motion]
speeds_mm_s = [40.0, 160.0]
forces_n = [0.5, 2.0]
[tolerance]
score = "gfc"
limit = 0.9
[budget]
microseconds = 10
bytes = 100000
contacts = 2
[surfaces.a]
simulated = "abdulali2016/S1"
friction = 0.4
[surfaces.b]
recordings = [{file = "%s", speed = 40.0, force = "f", fs_hz = 1000, unit = "g", column = "x"}]
"""
_PATH = "time,x,y,force,surface\n0,0,0,0.5,a\n0.1,1,0,1,a\n0.2,3,0,1.5,\n0.3,4,2,1,b\n"


def _card(path: Path) -> object:
    card = read_card(path)
    assert all(isinstance(note, str) for note in card.notes)
    if card.format == "simulated":
        assert len(open_dataset(path)) > 0
        return card.recipe
    assert 0 < card.fs_hz < float("inf")
    if card.format != "models":
        assert card.scale == card.scale
    if card.format == "files":
        match_name(card.files, "oak/01_X.csv")
    return hash(card.hash_input)


def _set(path: Path) -> object:
    generated = load_feature_set(path)
    assert generated.column_names
    return generated.hash


def _pipeline(path: Path) -> object:
    generated = load_pipeline(path)
    assert generated.rows
    assert generated.classifiers
    return [
        generated.preparation(row, next(iter(generated.classifiers))) for row in generated.rows
    ], generated.needed


def _scene(path: Path) -> object:
    generated = read_scene(path)
    assert generated.surfaces
    assert 0 < generated.device.rate_hz < float("inf")
    return generated


def _hand(path: Path) -> object:
    generated = read_path(path)
    assert len(generated.surfaces) == len(generated.time_s)
    try:
        (slow, fast), forces = generated.ranges()
    except ValueError as error:  # read_scene, which asks for it, names the file
        raise ValueError(f"{path}: {error}") from error
    assert slow <= fast < float("inf")
    return forces


def _cards() -> list[bytes]:
    return [_CARD.encode(), _ROWS.encode(), _RECIPE.encode(), *_shipped("datasets")]


def _shipped(kind: shipped.Kind) -> list[bytes]:
    return [
        path.read_bytes()
        for path in sorted(shipped.folder(kind).glob("*.toml"), key=lambda p: p.stat().st_size)[:3]
    ]


def _scenes() -> list[bytes]:
    texts = [_SCENE % Path(__file__).as_posix(), _SCENE.partition("[surfaces.b]")[0]]
    return [
        *(text.encode() for text in texts),
        min(EXAMPLES.glob("*.toml"), key=lambda p: p.stat().st_size).read_bytes(),
    ]


def _results() -> list[bytes]:
    folder = Path(__file__).parents[2] / "tests" / "reporting" / "data"
    return [path.read_bytes() for path in sorted(folder.glob("*.json"))]


def _page(path: Path) -> object:
    document = read_document(path)
    with damage_as_value_error(str(path)):
        page = render_page([document])
    assert page.startswith("<!")
    return page


TARGETS = (
    Target("dataset card", _cards, _card, _TOML, "card.toml"),
    Target("feature set", lambda: [_SET.encode(), *_shipped("feature_defs")], _set, _TOML, "set.toml"),
    Target("pipeline", lambda: [_PIPELINE.encode()], _pipeline, _TOML, "pipeline.toml"),
    Target("scene", _scenes, _scene, _TOML, "scene.toml"),
    Target("path of a hand", lambda: [_PATH.encode()], _hand, of_text, "path.csv"),
    Target("result for the page", _results, _page, trees(json.loads, json_of), "result.json"),
)
