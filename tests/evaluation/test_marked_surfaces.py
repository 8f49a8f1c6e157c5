"""Surfaces that are marked in one file are recordings of their own, but a split never separates them."""

import json
import logging

import numpy as np
import pandas as pd
import pytest
from toy_noises import a_table
from toy_surfaces import FS, SURFACES, N, signal

from texclass.evaluation.feature_table import cached_table, metadata
from texclass.evaluation.protocols import PROTOCOLS, find_protocol, min_per_surface
from texclass.evaluation.windows import cut_windows, files, parents
from texclass.features import load_feature_set
from texclass.loaders import open_dataset
from texclass.recognition import predict
from texclass.tradeoff.pareto_front import label_data

N_FILES = 5
READING = {"fs": FS, "unit": "m/s^2"}


@pytest.fixture(scope="module")
def sessions(tmp_path_factory):
    """Give a folder of files, each of which contains every surface once, and cork twice."""
    folder = tmp_path_factory.mktemp("sessions")
    names, length = ["cork", *SURFACES], N / FS
    for k in range(N_FILES):
        parts = [signal(SURFACES[name], [k, i]) for i, name in enumerate(names)]
        np.save(folder / f"session_{k}.npy", np.concatenate(parts))
        spans = [{"start_s": i * length, "end_s": (i + 1) * length} for i in range(len(names))]
        content = {
            "format": "texclass phases", "version": 1, "recording": f"session_{k}.npy", "fs_hz": FS,
            "duration_s": len(names) * length, "taps": [],
            # one movement over all surfaces is divided between them
            "movement": [{"start_s": 0.0, "end_s": len(names) * length}],
            "surfaces": [span | {"surface": name} for span, name in zip(spans, names, strict=True)],
        }  # fmt: skip
        (folder / f"session_{k}.phases.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


@pytest.mark.parametrize("window_s", [None, 0.2])
@pytest.mark.parametrize("protocol", ["recording", "paper", "grouped"])
def test_no_split_separates_the_surfaces_of_a_file(sessions, window_s, protocol):
    dataset = open_dataset(sessions, **READING)
    assert len(dataset) == N_FILES * 5
    if window_s is not None:
        dataset = cut_windows(dataset, window_s)
        assert len(dataset) == N_FILES * 5 * 2
        assert dataset.entries[2].recording_id == "session_0#2#1"
    table = metadata(dataset.entries)
    assert parents(table).nunique() == N_FILES * 5
    assert files(table).nunique() == N_FILES
    splits = PROTOCOLS[protocol].split(table, N_FILES, seed=0)
    assert len(splits) == N_FILES
    for train, test in splits:
        assert not set(files(table).iloc[train]) & set(files(table).iloc[test])
        assert set(table["surface"].iloc[test]) == set(SURFACES)
    assert sorted(np.concatenate([test for _, test in splits])) == list(range(len(table)))


def test_a_file_of_several_surfaces_has_no_surface_as_a_whole(sessions):
    dataset = open_dataset(sessions, **READING)
    assert dataset.find("session_0").surface is None
    assert dataset.find("session_0#1").surface == "cork"


def test_intervals_are_over_files_and_folds_are_limited_by_files(sessions):
    table = metadata(open_dataset(sessions, **READING).entries)
    unit, units = PROTOCOLS["recording"].independent(table)
    assert (unit, len(set(units))) == ("file", N_FILES)
    windows = metadata(cut_windows(open_dataset(sessions, **READING), 0.2).entries)
    unit, units = PROTOCOLS["shuffled-windows"].independent(windows)
    assert (unit, len(set(units))) == ("file", N_FILES)
    groups = label_data(np.zeros((len(table), 1)), table, PROTOCOLS["recording"]).groups
    assert groups.tolist() == files(table).tolist()  # of the inner folds of trade-offs
    assert min_per_surface(PROTOCOLS["recording"], table) == N_FILES  # cork has twice as many recordings
    with pytest.raises(ValueError, match="has 5 files; 6 folds grouped by file need at least 6"):
        PROTOCOLS["recording"].split(table, 6, seed=0)


@pytest.mark.parametrize("name", ["chronological", "few-shot 2"])
def test_files_of_the_test_set_are_removed_from_the_training_set(name):
    table = a_table(2, 8).assign(file_id=lambda t: "f" + t["repetition"].astype(str))
    # The first file contains another recording of m0, so its halves are other files than those of m1.
    more = table[table["recording_id"] == "m0_1"].assign(recording_id="m0_1#2")
    table = pd.concat([table, more], ignore_index=True)
    splits = find_protocol(name).split(table, 2, seed=0)
    for train, test in splits:
        assert len(train)
        assert not set(table["file_id"].iloc[train]) & set(table["file_id"].iloc[test])


def test_features_of_a_part_equal_those_of_a_file_with_the_same_samples(sessions, tmp_path):
    features = load_feature_set("texclass").restricted_to(["mfcc"])
    table = cached_table(open_dataset(sessions, **READING), features)
    assert table.frame["file_id"].tolist()[:5] == 5 * ["session_0"]
    for i, name in enumerate(SURFACES, start=1):
        (tmp_path / "alone" / name).mkdir(parents=True)
        np.save(tmp_path / "alone" / name / "0.npy", signal(SURFACES[name], [0, i]))
    card = tmp_path / "card.toml"
    card.write_text(
        f'folder = "alone"\nfs_hz = {FS}\nunit = "m/s^2"\nphases = "movement"\n'
        'files = "(?P<surface>[a-z]+)/.+"\n',
        encoding="utf-8",
    )
    alone = cached_table(open_dataset(card), features)
    assert alone.frame["surface"].tolist() == table.frame["surface"].tolist()[1:5]
    np.testing.assert_allclose(table.select(table.columns)[1:5], alone.select(alone.columns), rtol=1e-9)


def test_predict_gives_one_answer_per_marked_surface_and_one_note(sessions, linear_model, caplog):
    caplog.set_level(logging.WARNING)
    file = sessions / "session_0.npy"
    answers = list(predict(linear_model, [str(file)]))
    assert [item.name for item in answers] == [f"{file}#{k}" for k in range(1, 6)]
    assert [item.surface for item in answers] == ["cork", *SURFACES]
    assert [item.answer.surface for item in answers] == ["cork", *SURFACES]
    assert caplog.messages == ["note: phases of 5 recordings from NAME.phases.json, not detected"]
    in_folder = list(predict(linear_model, [str(sessions)]))
    assert len(in_folder) == 5 * N_FILES
    assert [item.answer for item in in_folder[:5]] == [item.answer for item in answers]
    assert linear_model.predict(f"{file}#4").surface == "oak"
