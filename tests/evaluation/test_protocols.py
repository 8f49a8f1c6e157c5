"""Protocols: recordings are never separated, and an impossible split is explained."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn.naive_bayes import GaussianNB
from sklearn.preprocessing import StandardScaler
from toy_noises import a_table

from texclass.classifiers.forward_selection import ForwardSelector
from texclass.evaluation.folds import evaluate
from texclass.evaluation.protocols import PROTOCOLS, find_protocol, repeated_splits
from texclass.evaluation.splits import n_starts

RECORDING_PROTOCOLS = {name: one for name, one in PROTOCOLS.items() if one.separates_recordings}
"""Protocols that split recordings; `shuffled-windows` splits windows regardless of their recording."""


def split(name, table, n_folds=10, seed=0):
    return find_protocol(name).split(table, n_folds, seed)


def test_no_recording_trains_and_tests_in_one_fold_and_each_is_tested_once_where_folds_cover_all():
    table = a_table()
    for name, protocol in RECORDING_PROTOCOLS.items():
        folds = split(name, table)
        for train, test in folds:
            assert not set(train) & set(test)
            assert set(table["surface"][test]) == set(table["surface"][train])
        if protocol.is_random or name == "operator":
            assert sorted(np.concatenate([test for _, test in folds])) == list(range(30))
        assert n_starts(folds) == (3 if name == "few-shot" else None)
    assert [p.name for p in PROTOCOLS.values() if not p.is_nested] == ["paper"]


def test_a_protocol_needs_its_labels_and_no_other():
    for name, protocol in RECORDING_PROTOCOLS.items():
        needless = {"operator", "session", "repetition"} - set(protocol.needs)
        assert split(name, a_table().assign(**dict.fromkeys(needless, None)))
        if protocol.needs:
            with pytest.raises(ValueError, match=protocol.needs[0]):
                split(name, a_table().assign(**dict.fromkeys(protocol.needs, None)))


def test_the_guide_lists_every_protocol():
    guide = (Path(__file__).parents[2] / "docs" / "classify.md").read_text(encoding="utf-8")
    table = guide.partition("| `--protocol` |")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `([^`]+)` \|", table, flags=re.M) == list(PROTOCOLS)


def test_permuted_labels_stay_at_chance_under_every_protocol():
    """What a recording (or run) has of its own names it; labels say nothing, so parting it would show."""
    recordings = a_table(4, 20).assign(session=[f"{m}/{r // 2}" for m in range(4) for r in range(20)])
    table = recordings.loc[recordings.index.repeat(3)].rename(columns={"recording_id": "parent"})
    table = table.assign(recording_id=[f"w{i}" for i in range(240)]).reset_index(drop=True)
    for name, protocol in RECORDING_PROTOCOLS.items():
        _, unit = np.unique(protocol.clusters(table), return_inverse=True)
        chooser = (
            ForwardSelector(GaussianNB(), n_features_to_select=2) if protocol.is_nested else StandardScaler()
        )
        right = []
        for seed in range(5):
            X = np.random.default_rng(seed).normal(size=(unit.max() + 1, 8))[unit]
            splits = protocol.split(table, 4, seed)
            right.append(
                evaluate(X, table["surface"].to_numpy(), splits, chooser, GaussianNB()).accuracy.mean
            )
        assert np.mean(right) == pytest.approx(0.25, abs=0.1), name


def test_shuffled_windows_are_split_by_surface_and_not_by_recording():
    table = a_table().rename(columns={"recording_id": "parent"}).loc[lambda t: t.index.repeat(4)]
    table = table.assign(recording_id=[f"w{i}" for i in range(120)]).reset_index(drop=True)
    folds = split("shuffled-windows", table)
    assert sorted(np.concatenate([test for _, test in folds])) == list(range(120))
    for train, test in folds:
        assert not set(train) & set(test)
        assert len(train) + len(test) == len(table)
        assert table["surface"][test].value_counts().to_dict() == {"m0": 4, "m1": 4, "m2": 4}
        assert set(table["parent"][test]) <= set(table["parent"][train])
    # Windows that overlap others contain parts of test windows. They are in neither set.
    mixed = table.assign(is_train_only=table.index % 2 == 1)
    for train, test in split("shuffled-windows", mixed):
        assert len(train) + len(test) == 60
        assert not mixed["is_train_only"][[*train, *test]].any()
    protocol = find_protocol("shuffled-windows")
    name, units = protocol.independent(table)
    assert (name, len(set(units)), len(set(protocol.clusters(table)))) == ("recording", 30, 120)


def test_operator_leaves_one_out_entirely_and_falls_back_to_sessions():
    table = a_table()
    folds = split("operator", table)
    assert len(folds) == 5
    for train, test in folds:
        assert not set(table["operator"][train]) & set(table["operator"][test])
    assert len(split("operator", table.assign(operator=None, session=["a", "b"] * 15))) == 2


def test_blocks_train_on_the_first_repetitions_whatever_the_order_of_rows():
    table = a_table(2, 9).sample(frac=1, random_state=0, ignore_index=True)
    ((train, test),) = split("chronological", table)
    assert set(table["repetition"][train]) == {1, 2, 3, 4}
    assert set(table["repetition"][test]) == {5, 6, 7, 8, 9}


@pytest.mark.parametrize(
    ("name", "n", "starts", "tests"),
    [
        ("few-shot", 40, [range(s, s + 3) for s in (1, 6, 11, 16)], [range(21, 31), range(31, 41)]),
        ("few-shot 1", 40, [[1], [6], [11], [16]], [range(21, 31), range(31, 41)]),
        ("few-shot 10", 40, [range(1, 11), range(6, 16), range(11, 21)], [range(21, 31), range(31, 41)]),
        ("few-shot", 9, [[1, 2, 3], [2, 3, 4]], [[5, 6], [7, 8, 9]]),
        ("few-shot", 6, [[1, 2, 3]], [[4], [5, 6]]),
        ("few-shot 1", 2, [[1]], [[2]]),
    ],
)
def test_few_shot_has_as_many_starts_as_fit_before_the_same_later_tests(name, n, starts, tests):
    table = a_table(2, n).sample(frac=1, random_state=0, ignore_index=True)
    table["repetition"] += 7 * (table["surface"] == "m1")  # numbers of a surface need not begin at 1
    splits_by_name = [
        [[*table["repetition"][rows][table["surface"][rows] == "m0"].sort_values()] for rows in fold]
        for fold in split(name, table)
    ]
    assert splits_by_name == [[list(start), list(test)] for start in starts for test in tests]
    assert n_starts(split(name, table)) == (len(starts) if len(starts) > 1 else None)


def test_few_shot_draws_runs_where_recordings_have_no_number():
    runs = [f"m{m}/run{r // 2}" for m in range(3) for r in range(10)]
    table = a_table(repetition=None).assign(session=runs)
    folds = split("few-shot", table)
    assert len({train.tobytes() for train, _ in folds}) == len(folds) == 4
    for train, test in folds:
        assert not set(table["session"][train]) & set(table["session"][test])
        assert (table.iloc[train].groupby("surface")["session"].nunique() == 3).all()
        assert len(train) + len(test) == len(table)
    assert all(np.array_equal(a, b) for a, b in zip(folds[0], split("few-shot", table)[0], strict=True))
    assert not np.array_equal(folds[0][0], split("few-shot", table, seed=1)[0][0])


def test_no_run_trains_and_tests_and_every_fold_tests():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        runs = [(f"m{m}", f"m{m}/run{r}") for m in range(3) for r in range(5)]
        rows = [run for run in runs for _ in range(rng.integers(1, 12))]
        table = pd.DataFrame(rows, columns=["surface", "session"]).assign(operator=None, repetition=None)
        table["recording_id"] = [f"r{i}" for i in range(len(table))]
        folds = split("grouped", table, 5, seed)
        assert len(folds) == 5
        for train, test in folds:
            assert not set(table["session"][train]) & set(table["session"][test])
            assert set(table["surface"][train]) == {"m0", "m1", "m2"}
    # Without sessions a run is a recording.
    assert find_protocol("grouped").clusters(a_table()).tolist() == a_table()["recording_id"].tolist()


def test_splits_follow_the_seed_and_repeats_are_those_of_the_next_seeds():
    for name in ("recording", "grouped", "paper"):
        repeats = repeated_splits(find_protocol(name), a_table(), 5, 3, 7)
        for r, folds in enumerate(repeats):
            tests = [test.tolist() for _, test in folds]
            assert tests == [test.tolist() for _, test in split(name, a_table(), 5, 7 + r)]
        assert repeats[0][0][1].tolist() != repeats[1][0][1].tolist()
    for name, n in (("recording", 0), ("chronological", 2), ("few-shot", 3), ("operator", 2)):
        with pytest.raises(ValueError, match=f"n_repeats is {n} for the protocol `{name}`. Expected 1"):
            repeated_splits(find_protocol(name), a_table(), 5, n, 0)


def test_an_impossible_split_raises_an_error_with_value_and_expectation():
    few, single = a_table(3, 10).iloc[9:], a_table(3, 1, operator=["a", "b", "b"])
    three_runs = a_table().assign(session=["a", "b", "c"] * 10)
    for name, table, message in (
        ("recording", few, "surface m0 has 1 recording; 10 folds need at least 10 of each"),
        ("recording", a_table(1, 10), "1 surface. Classification needs at least 2"),
        (
            "recording",
            a_table(2, 7),
            "7 recordings; 10 folds need at least 10 of each. Use 2 to 7 folds: `--folds 7`",
        ),
        ("grouped", a_table(2, 7), "m0 has 7 runs; 10 folds .* at least 10 of each. Use 2 to 7 folds"),
        (
            "grouped",
            three_runs,
            "has 3 runs; 10 folds grouped by run need at least 10 of each. Use 2 to 3 folds",
        ),
        ("few-shot", a_table(3, 5), "m0 has 5 recordings. The protocol `few-shot` needs 6 per surface"),
        (
            "few-shot",
            a_table(3, 3, repetition=None),
            "m0 has 3 runs. The protocol `few-shot` needs 4 per surface",
        ),
        ("few-shot 0", a_table(), "unknown protocol 'few-shot 0'.*few-shot NUMBER"),
        ("operator", a_table(operator=None), "0 operators and 0 sessions"),
        ("operator", a_table(operator="o1"), "1 operators and 0 sessions"),
        ("operator", single, "surface m0 has no recording without operator a"),
        ("chronological", a_table(3, 1), "surface m0 has 1 recording"),
        ("chronological", a_table(repetition=None), "recording m0_1 has no repetition number"),
        (
            "random",
            a_table(),
            f"{', '.join(PROTOCOLS)}, few-shot NUMBER, leave-out LABEL\\[,LABEL\\], LABEL=VALUES",
        ),
        (
            "repetition=0-4 -> repetition=4-9",
            a_table(),
            "recording m0_4 is in the training set and in the test set",
        ),
        ("repetition=0-4 -> repetition=40-49", a_table(), "has repetition '40-49'. Expected one of: 1, 2, 3"),
        (
            "repetition=0-4 -> smell=a",
            a_table(),
            "no recording has the label 'smell'. Expected one of surface, repetition, operator",
        ),
        ("repetition=0-4 -> session", a_table(), "by 'session'. Expected LABEL=VALUE,VALUE"),
        (
            "leave-out session",
            a_table(),
            "30 of 30 recordings have no session, for example 'm0_1'. .* needs a value for every recording",
        ),
        (
            "shuffled-windows",
            a_table(),
            "contains whole recordings. Cut them into windows: `texclass benchmark --window",
        ),
        (
            "shuffled-windows",
            a_table(2, 7).assign(parent=lambda table: table["recording_id"]),
            "m0 has 7 windows; 10 folds need at least 10 of each. Use 2 to 7 folds",
        ),
        ("leave-one", a_table(), "unknown protocol 'leave-one'.*leave-out LABEL"),
        ("leave-out surface", a_table(), "has no recording without surface"),
    ):
        with pytest.raises(ValueError, match=message):
            split(name, table.reset_index(drop=True))


def test_any_label_defines_training_set_and_test_set():
    table = a_table().assign(session=["a", "b"] * 15)
    ((train, test),) = split("repetition=1-3,5 -> repetition=6-9 & session=a", table)
    assert set(table["repetition"][train]) == {1, 2, 3, 5}
    assert set(table["repetition"][test]) <= {6, 7, 8, 9}
    assert set(table["session"][test]) == {"a"}
    assert len(train) == 12
    folds = split("leave-out session", table)
    assert [set(table["session"][test]) for _, test in folds] == [{"a"}, {"b"}]
    for train, test in folds:
        assert not set(table["session"][train]) & set(table["session"][test])


def labelled():
    """A table with speeds and forces: each surface at each of six conditions, twice."""
    conditions = [(speed, force) for speed in ("20", "30", "50") for force in ("0.5", "2.5")]
    speeds, forces = zip(*(conditions * 2), strict=True)
    return a_table(2, 12).assign(speed=[*speeds] * 2, force=[*forces] * 2)


def test_combinations_of_labels_are_left_out_in_turn_and_are_independent():
    table = labelled()
    folds = split("leave-out speed,force", table)
    combinations = [set(zip(table["speed"][test], table["force"][test], strict=True)) for _, test in folds]
    assert len(folds) == len({*map(frozenset, combinations)}) == 6
    for (train, test), (left_out,) in zip(folds, combinations, strict=True):
        assert left_out not in set(zip(table["speed"][train], table["force"][train], strict=True))
        assert len(train) + len(test) == len(table)
    unit, values = find_protocol("leave-out speed, force").independent(table)
    assert (unit, len(set(values))) == ("speed-force combination", 6)
    assert find_protocol("leave-out speed").independent(table)[0] == "speed"


def test_values_with_commas_are_different_combinations():
    table = labelled().assign(speed=["a, b", "a"] * 12, force=["c", "b, c"] * 12)
    assert len(split("leave-out speed,force", table)) == 2


@pytest.mark.parametrize(
    ("name", "trained", "tested"),
    [
        ("speed=20-30 -> speed=50", {"20", "30"}, {"50"}),
        ("speed=20,50 -> speed=25.5-30", {"20", "50"}, {"30"}),
        ("speed=20 & force=0.4-0.6 -> speed=50 & force=0.5", {"20"}, {"50"}),
    ],
)
def test_ranges_of_any_label_may_have_decimals(name, trained, tested):
    table = labelled()
    ((train, test),) = split(name, table)
    assert (set(table["speed"][train]), set(table["speed"][test])) == (trained, tested)
    if "force" in name:
        assert set(table["force"][test]) == set(table["force"][train]) == {"0.5"}


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        (
            "leave-out tool",
            {},
            "no recording has the label 'tool'. Expected one of surface, repetition, operator, ",
        ),
        ("leave-out speed,tool", {}, "no recording has the label 'tool'. .*speed, force"),
        ("leave-out recording_id", {}, "no recording has the label 'recording_id'"),
        ("tool=a -> tool=b", {}, "no recording has the label 'tool'"),
        ("speed=70 -> speed=20", {}, "no recording has speed '70'. Expected one of: 20, 30, 50"),
        ("leave-out speed", {"speed": "20"}, "all recordings have the same speed, '20'. .* at least 2"),
        ("leave-out speed,force", {"speed": "20", "force": "1"}, "the same speed and force, '20, 1'"),
        ("leave-out speed", {"speed": ["20", None, "30"] * 8}, "8 of 24 recordings have no speed, .* 'm0_2'"),
        (
            "leave-out speed",
            {"speed": ["20"] * 12 + ["20", "30"] * 6, "surface": ["m0"] * 12 + ["m1"] * 12},
            "surface m0 has no recording without speed 20. The training set must contain",
        ),
        ("leave-out ", {}, "cannot leave out ''. Expected different labels"),
        ("leave-out speed,speed", {}, "cannot leave out 'speed,speed'"),
        ("=20 -> speed=20", {}, "cannot select recordings by ''"),
    ],
)
def test_a_split_by_unsuitable_labels_raises_an_error(name, changes, message):
    with pytest.raises(ValueError, match=message):
        split(name, labelled().assign(**changes))


def test_a_feature_is_no_label_in_messages():
    with pytest.raises(ValueError, match=r"Expected one of surface, repetition, operator, speed, force$"):
        split("leave-out tool", labelled().assign(hardness=1.5, is_train_only=False))


def test_what_is_left_out_is_independent_else_runs_or_recordings():
    table = a_table().assign(session=[f"s{i % 3}" for i in range(30)])
    for name, unit, n in (
        ("operator", "operator", 5), ("leave-out session", "session", 3), ("grouped", "run", 3),
        ("recording", "recording", 30), ("chronological", "recording", 30),
    ):  # fmt: skip
        splits_by_name, of = find_protocol(name).independent(table)
        assert (splits_by_name, len(set(of))) == (unit, n)
    assert find_protocol("operator").independent(table.assign(operator=None))[0] == "session"
