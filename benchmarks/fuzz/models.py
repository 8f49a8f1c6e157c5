"""Fuzzing targets: trained models, manifests, recognisers, feature tables, checkpoints and caches."""

import io
import json
import os
import random
import sys
import tempfile
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.preprocessing import StandardScaler

from fuzz.contract import Target
from fuzz.mutate import Tree, archives, either, json_of, members_of, of_bytes, of_tree, trees
from fuzz.recordings import valid, written
from texclass.baselines.worker_process import read_outcome
from texclass.classifiers import KernelDiscriminant
from texclass.evaluation.feature_table import (
    FeatureTable,
    LeftOutRecording,
    read_checkpoint,
    read_table,
    write_table,
)
from texclass.evaluation.windows import read_movements
from texclass.features.reasons import Reason
from texclass.loaders.simulated import read_cached, write_cached
from texclass.recognition import load_model
from texclass.recognition.model_files import Manifest, digest_of, read_manifest
from texclass.recording import Recording
from texclass.tradeoff.recogniser import load_recogniser, save_recogniser

_JSON = trees(json.loads, json_of)


def _sealed(rng: random.Random, members: dict[str, bytes]) -> dict[str, bytes]:
    """Mutate the manifest or the contents of a model file and correct its digest."""
    described = [name for name in ("schema.json", "arrays.json") if name in members]
    name = rng.choice([*2 * described, *sorted(members)])
    members[name] = _changed_member(rng, name, members[name])
    if "manifest.json" in members:
        header = json.loads(members.pop("manifest.json"))
        header.pop("digest", None)
        header["digest"] = digest_of(header, members)
        members["manifest.json"] = json_of(header)
    return members


def _changed_member(rng: random.Random, name: str, data: bytes) -> bytes:
    if name.endswith(".npy"):
        return data[:128] + of_bytes(rng, data[128:])[: len(data) - 128].ljust(len(data) - 128, b"\1")
    tree = json.loads(data)
    if rng.random() < 0.2:
        inner = list(_inner_json(tree))
        if inner:
            place, key = rng.choice(inner)
            place[key] = json.dumps(json_of(of_tree(rng, json.loads(json.loads(place[key])))).decode())
            return json_of(tree)
    return json_of(of_tree(rng, tree))


def _inner_json(tree: Tree) -> list[tuple[dict[str, object], str]]:
    """Return where a description holds JSON within JSON: the plan of features."""
    documents = []
    for inner in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        documents += _inner_json(inner)
    if isinstance(tree, dict) and isinstance(tree.get("content"), str) and '[[\\"' in tree["content"]:
        documents.append((tree, "content"))
    return documents


@cache
def _models() -> list[bytes]:
    """Return a model of arrays, one with a step that skops writes, and the recogniser of this one."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
    from toy_models import fitted, model_of

    arrays = model_of([SimpleImputer(), StandardScaler()], KernelDiscriminant())
    of_skops, recogniser = fitted([SimpleImputer(), PCA(3)], LinearDiscriminantAnalysis())
    saves = (arrays.save, of_skops.save, partial(save_recogniser, recogniser))
    return [written("a.skops", save) for save in saves]


def _manifest(data: bytes) -> Manifest:
    documents = read_manifest(data)
    assert np.isfinite(documents.fs)
    assert isinstance(documents.surfaces, tuple)
    return documents


def _tables() -> list[bytes]:
    frame = pd.DataFrame({"recording_id": ["a", "b"], "surface": ["oak", "felt"], "operator": [None, "o"],
                          "session": [None, None], "repetition": pd.array([1, None], dtype="Int64"),
                          "mfcc.c1": [1.0, np.nan]})  # fmt: skip
    table = FeatureTable(frame, ("mfcc.c1",), np.array([1.0, 2.0]), (Reason("b", "mfcc", "short"),), (),
                         (LeftOutRecording("c", "bad"),), "key")  # fmt: skip
    return [written("a.npz", lambda p: write_table(table, p))]


def _table(path: Path) -> object:
    table = read_table(path)
    values = table.values  # noqa: PD011
    assert values.shape == (table.n_recordings, table.n_columns)
    assert table.ms.shape == (table.n_recordings,)
    return table


def _table_facts(rng: random.Random, data: bytes) -> bytes:
    """Change the JSON within a table."""
    try:
        with np.load(io.BytesIO(data)) as arrays:
            values, facts = arrays["values"], json.loads(arrays["facts"].tobytes())
        changed, sink = json_of(of_tree(rng, facts)), io.BytesIO()
        np.savez(sink, values=values, facts=np.frombuffer(changed, np.uint8))
        return sink.getvalue()
    except Exception:
        return of_bytes(rng, data)


def _part(path: Path) -> object:
    rows = read_checkpoint(path, 2)
    assert all(len(row.features) == 2 and np.isfinite(row.ms) for row in rows)
    return rows


def _movements(path: Path) -> object:
    documents = read_movements(path, 2)
    assert len(documents) == 2
    assert all(0 <= start <= stop and fs > 0 for start, stop, fs, _ in documents)
    return documents


def _remembered() -> list[bytes]:
    signal = Recording(np.arange(24.0).reshape(8, 3), 100.0, "g", "r", surface="oak", flags=("a",))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.npz"
        write_cached(path, signal)
        return [path.read_bytes()] if path.is_file() else []


def _recall(path: Path) -> object:
    documents = read_cached(path)
    return documents and valid(documents)


def _facts(rng: random.Random, members: dict[str, bytes]) -> dict[str, bytes]:
    name = rng.choice(sorted(members))
    members[name] = members[name][:128] + of_bytes(rng, members[name][128:])
    return members


def _outcome(path: Path) -> object:
    """What a worker of a baseline wrote: the same bytes stand for each of its files in turn."""
    names = ("started.json", "fold_0.json", "failed.json")
    try:
        for name in names:
            os.link(path, path.with_name(name))
            path.with_name("stderr.txt").touch()
            read_outcome(path.parent, expired=False, time_limit_s=1.0)
            path.with_name(name).unlink()
    finally:
        for name in (*names, "stderr.txt"):
            path.with_name(name).unlink(missing_ok=True)
    return None


_PART = (
    b'[{"features": [1.0, NaN], "axes": ["x"], "rates": {"friction": 9.0}, "phases": [1, 2.0, 3.0], '
    b'"ms": 2.0, "reasons": [["mfcc", "short"]], "flags": ["clipped"]}]'
)
_OUTCOME = b'{"first_s": 1.0, "versions": {"aeon": "1"}, "missing": false, "message": "x", "predicted": [0]}'
_SEALED = archives(_sealed, deflate=False)
TARGETS = (
    Target("model", lambda: _models()[:2], load_model, _SEALED, "fuzzed.skops", (UserWarning,)),
    Target("recogniser", lambda: _models()[2:], load_recogniser, _SEALED, "recogniser.skops", (UserWarning,)),
    Target("manifest", lambda: [members_of(_models()[0])["manifest.json"]], _manifest, _JSON),
    Target("feature table", _tables, _table, either(_table_facts, of_bytes), "table.npz"),
    Target("part of an extraction", lambda: [_PART], _part, _JSON, "part.json"),
    Target("cached movements", lambda: [b"[[0, 10, 1000.0, \"\"], [3, 9, 1000.0, \"\"]]"], _movements, _JSON,
           "movements.json"),
    Target("cached recording", _remembered, _recall, archives(_facts, deflate=False), "r.npz"),
    Target("outcome of a baseline", lambda: [_OUTCOME], _outcome, _JSON, "outcome.json"),
)  # fmt: skip
