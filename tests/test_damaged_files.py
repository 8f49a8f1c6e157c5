"""Damaged definitions, manifests, results and tables raise the documented errors."""

import json

import numpy as np
import pytest
from fuzz.contract import judge
from fuzz.mutate import json_of
from fuzz.recordings import OF_BAGS
from fuzz.targets import LIBRARIES, target_of

from texclass.evaluation.feature_table import read_checkpoint, read_table
from texclass.loaders import CardError
from texclass.loaders.readers import formats
from texclass.recording import RecordingError

LONG = "9" * 5000
SPOILT = {
    "dataset card": [
        ('format = "files"', "format = []"),
        ("fs_hz = 1000", "fs_hz = inf"),
        ("fs_hz = 1000", f"fs_hz = 1{'0' * 400}"),
        ("scale = 0.5", "scale = nan"),
        ('delimiter = ";"', 'delimiter = ""'),
        ("[0-9]+", "a{99999999999}"),
        ("[0-9]+", f"{'(' * 3000}{')' * 3000}"),
        ("n_surfaces = 2", "n_surfaces = 1000000000000"),
        ("duration_s = 1.0", "duration_s = 1e300"),
        ("fs = 1000", f"fs = 1{'0' * 400}"),
    ],
    "feature set": [
        ("[features.again]", "[features.band_level]\nn_pieces = 1000000000\n[features.again]"),
        ("[features.again]", "[features.octave_level]\noctaves = [2, 2147483648]\n[features.again]"),
        ("[features.again]", '[features.octave_level]\noctaves = ["a", "b"]\n[features.again]'),
        ("[1, 2]", "[1, 1]"),
    ],
    "pipeline": [
        ('name = "recording"', 'name = ["recording"]'),
        ('steps = [{use = "sklearn.preprocessing.StandardScaler"}]', "steps = 5"),
        ('features = ["fineness", "temporal_roughness"]', "features = 5"),
        ('features = ["fineness", "temporal_roughness"]', 'features = [["fineness"]]'),
        ("published = {lda = 80.5}", "published = {lda = 80.5}\nclassifiers = [[]]"),
        ("[classifiers]\nlda =", "classifiers = [5] #"),
    ],
    "scene": [
        ("seed = 3", f"seed = 1{'0' * 400}"),
        ("rate_hz = 1000", f"rate_hz = 1{'0' * 400}"),
        ("[20.0, 450.0]", f"[20, 1{'0' * 400}]"),
        ('simulated = "abdulali2016/S1"', 'texture = "~nobody-of-this-name/x.texture"'),
        ('simulated = "abdulali2016/S1"', f'texture = "{LONG}"'),
    ],
    "path of a hand": [
        ("0.1,1,0", "5e-324,1e300,0"),
        ("0,0,0,0.5,a", f"0,{'9' * 400},0,0.5,a"),
    ],
}
"""Reader -> what is exchanged in a valid input for what nothing can be."""


@pytest.mark.parametrize("suffix", [suffix for suffix, kind in formats().items() if "text" not in kind.name])
def test_a_truncated_recording_is_an_error_or_flagged(suffix, tmp_path):
    """A shorter recording without a flag would look whole; the end of a text cannot be seen in it."""
    extra = formats()[suffix].extra
    for library in LIBRARIES.get(extra, ()):
        pytest.importorskip(library, reason=f"the extra `{extra}` is not installed")
    target = target_of(OF_BAGS.get(suffix, suffix[1:]))
    data, path = target.seeds()[0], tmp_path / f"a{suffix}"
    path.write_bytes(data)
    whole = target.read(path)
    for length in range(1, len(data), max(1, len(data) // 100)):
        path.write_bytes(data[:length])
        try:
            recording = target.read(path)
        except RecordingError:
            continue
        is_reported = set(recording.flags) > set(whole.flags)
        assert is_reported or np.array_equal(recording.acceleration, whole.acceleration), length


def _refused(name, data, tmp_path):
    verdict = judge(target_of(name), data, tmp_path)
    assert verdict.kind == "refused", (verdict.kind, verdict.detail)


def _changed(name, old, new, tmp_path):
    whole = target_of(name).seeds()
    data = next(seed for seed in whole if old.encode() in seed)
    _refused(name, data.replace(old.encode(), new.encode(), 1), tmp_path)


@pytest.mark.parametrize("name", SPOILT)
def test_an_invalid_value_is_an_error(name, tmp_path):
    """Kinds of values, numbers beyond floats, columns without names, homes of strangers."""
    for old, new in SPOILT[name]:
        _changed(name, old, new, tmp_path)


@pytest.mark.parametrize("name", ["dataset card", "feature set", "pipeline", "scene"])
@pytest.mark.parametrize(
    "text",
    [f"a = {'[' * 3000}", f"a = {LONG}", f"{'a.' * 32_000}b = 1", "#" * 1_100_000],
    ids=["nested", "long integer", "deep key", "large"],
)
def test_toml_with_excessive_depth_or_size_is_an_error(name, text, tmp_path):
    whole = target_of(name).seeds()[0] if text.startswith("#") else b""
    _refused(name, whole + text.encode(), tmp_path)


def test_test_modules_of_libraries_are_not_imported(tmp_path, monkeypatch):
    from texclass.evaluation import allowed_estimators

    refuse = lambda name: pytest.fail(f"imported {name}")  # noqa: E731
    monkeypatch.setattr(allowed_estimators.importlib, "import_module", refuse)
    with pytest.raises(ValueError, match="is not an allowed estimator"):
        allowed_estimators.resolve("sklearn.tests.test_base.MyEstimator")


def test_the_scene_of_a_path_that_never_touches_is_named(tmp_path):
    (tmp_path / "p.csv").write_text("time,x,y,force,surface\n0,0,0,0,a\n1,1,0,0,a\n")
    data = target_of("scene").seeds()[0].decode()
    ranges = "speeds_mm_s = [40.0, 160.0]\nforces_n = [0.5, 2.0]"
    assert ranges in data
    _refused("scene", data.replace(ranges, 'path = "p.csv"').encode(), tmp_path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("schema", [float("inf"), 1]),
        ("fs", 10**400),
        ("fs", float("nan")),
        ("surfaces", [1, None]),
        ("input", []),
        ("window_s", "long"),
        ("shortest_s", float("inf")),
        ("unit", None),
    ],
)
def test_a_manifest_with_a_value_of_another_type_is_an_error(name, value, tmp_path):
    manifest = json.loads(target_of("manifest").seeds()[0]) | {name: value}
    _refused("manifest", json_of(manifest), tmp_path)


@pytest.mark.parametrize("number", ["1e999", f"1{'0' * 400}", "1e308", "-1e999"])
def test_a_result_with_a_number_too_large_for_a_figure_is_an_error(number, tmp_path):
    _changed("result for the page", '"ms_per_recording": 3.5', f'"ms_per_recording": {number}', tmp_path)


@pytest.mark.parametrize("text", [b"[", b"\xff", b"[]", b"[" * 5000, b"{}"])
def test_a_truncated_result_of_a_baseline_is_a_failure(text, tmp_path):
    from texclass.baselines.worker_process import read_outcome

    for name in ("started.json", "fold_0.json", "failed.json", "stderr.txt"):
        (tmp_path / name).write_bytes(text)
    outcome = read_outcome(tmp_path, expired=False, time_limit_s=1.0)
    assert outcome["status"] == "failed"


@pytest.mark.parametrize(
    "text", ["5", "[5]", "[[0, 1]]", '[["a", 1, 1.0]]', "[[2, 1, 9.0]]", "[" * 5000, "[]"]
)
def test_damaged_movements_are_detected_again(text, tmp_path, monkeypatch):
    from texclass.evaluation import windows
    from texclass.loaders import Dataset, Entry
    from texclass.recording import Phases, Recording

    def load(entry):
        return Recording(range(100), 100.0, "g", entry.recording_id, phases=Phases(movement=(10, 90)))

    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path))
    dataset = Dataset("d", (Entry("a", "oak"),), load, "hash")
    whole = windows.cut_windows(dataset, 0.5)
    (file,) = (tmp_path / "movements").iterdir()
    file.write_text(text)
    assert [window.start for window in windows.cut_windows(dataset, 0.5).entries] == [
        w.start for w in whole.entries
    ]


def test_a_row_with_a_number_beyond_floats_is_refused(tmp_path):
    data = b"label,0,1\noak,1,2\nfelt," + b"9" * 400 + b",3\n"
    _refused("table of rows", data, tmp_path)


def test_a_missing_label_is_an_error_with_its_row(tmp_path):
    for line in (b"r2", b"r2,felt", b"r2,felt,1,more"):
        _refused("table of labels", b"id,what,run\nr1,oak,1\n" + line + b"\n", tmp_path)
    (tmp_path / "labels.csv").write_bytes(b"id,what,run\nr1,oak,1\nr2\n")
    with pytest.raises(CardError, match=r"labels\.csv: row 3 has 1 cell\. Expected 3"):
        target_of("table of labels").read(tmp_path / "labels.csv")


def _facts(path, **changes):
    with np.load(path) as arrays:
        values, facts = arrays["values"], json.loads(arrays["facts"].tobytes())
    changed = json.dumps(facts | changes).encode()
    np.savez(path, values=values, facts=np.frombuffer(changed, np.uint8))


@pytest.mark.parametrize(
    "changes",
    [{"columns": 5}, {"columns": ["surface"]}, {"columns": ["a", "b"]}, {"labels": {}}, {"ms": ["x", "y"]},
     {"ms": [1.0]}, {"reasons": [["too", "few"]]}, {"flags": 1}, {"left_out": None}, {"key": []}],
)  # fmt: skip
def test_a_feature_table_with_inconsistent_metadata_is_an_error(changes, tmp_path):
    path = tmp_path / "t.npz"
    path.write_bytes(target_of("feature table").seeds()[0])
    assert read_table(path).n_recordings == 2
    _facts(path, **changes)
    with pytest.raises(ValueError, match=r"t\.npz: not a feature table of texclass"):
        read_table(path)


@pytest.mark.parametrize(
    "row",
    [{"features": None}, {"features": [1.0]}, {"features": ["a", "b"]}, {"reasons": "["}, {"reasons": [[1]]},
     {"flags": 5}, {"ms": None}, {"ms": "x"}, {"ms": float("inf")}, {"axes": None}, {"phases": [1]},
     {"rates": 5}],
)  # fmt: skip
def test_a_damaged_part_of_an_extraction_says_what_to_do(row, tmp_path):
    path = tmp_path / "p.json"
    whole = {"features": [1.0, float("nan")], "reasons": [["mfcc", "short"]], "flags": [], "ms": 1.0}
    whole |= {"axes": ["x"], "rates": {"friction": 100.0}, "phases": [1, 2.0, 3.0]}
    path.write_text(json.dumps([whole]))
    assert read_checkpoint(path, 2)[0].ms == 1.0
    path.write_text(json.dumps([whole | row]))
    with pytest.raises(ValueError, match=r"p\.json is damaged.*Delete it"):
        read_checkpoint(path, 2)
