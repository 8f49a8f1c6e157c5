"""Protocols: recordings are the unit, and an impossible split says why."""

import numpy as np
import pandas as pd
import pytest

from texclass.experiment.protocols import PROTOCOLS, find_protocol, repeated


def a_table(n_materials=3, n_repetitions=10, **columns):
    rows = [(f"m{m}", r) for m in range(n_materials) for r in range(1, n_repetitions + 1)]
    table = pd.DataFrame(rows, columns=["material", "repetition"])
    table["recording_id"] = table["material"] + "_" + table["repetition"].astype(str)
    table["operator"] = [f"o{r % 5}" for r in table["repetition"]]
    return table.assign(session=None, **columns)


@pytest.mark.parametrize("name", PROTOCOLS)
def test_no_recording_trains_and_tests_in_one_fold(name):
    table = a_table()
    for train, test in find_protocol(name).split(table, 10, 0):
        assert not set(train) & set(test)
        assert set(table["material"][test]) == set(table["material"][train])


@pytest.mark.parametrize("name", ["recording", "operator", "run", "paper"])
def test_every_recording_is_tested_once(name):
    tested = np.concatenate([test for _, test in find_protocol(name).split(a_table(), 10, 0)])
    assert sorted(tested) == list(range(30))


def test_operator_leaves_one_out_entirely_and_falls_back_to_sessions():
    table = a_table()
    splits = find_protocol("operator").split(table, 10, 0)
    assert len(splits) == 5
    for train, test in splits:
        assert not set(table["operator"][train]) & set(table["operator"][test])
    sessions = table.assign(operator=None, session=["a", "b"] * 15)
    assert len(find_protocol("operator").split(sessions, 10, 0)) == 2


def test_blocks_trains_on_the_first_half_whatever_the_order_of_rows():
    table = a_table(2, 5).sample(frac=1, random_state=0, ignore_index=True)
    ((train, test),) = find_protocol("blocks").split(table, 10, 0)
    assert set(table["repetition"][train]) == {1, 2}
    assert set(table["repetition"][test]) == {3, 4, 5}


def test_few_shot_trains_on_three_and_tests_what_blocks_tests():
    table = a_table(2, 9).sample(frac=1, random_state=0, ignore_index=True)
    ((train, test),) = find_protocol("few-shot").split(table, 10, 0)
    assert sorted(table["repetition"][train]) == [1, 1, 2, 2, 3, 3]
    ((_, second_half),) = find_protocol("blocks").split(table, 10, 0)
    assert test.tolist() == second_half.tolist()


@pytest.mark.parametrize("seed", range(20))
def test_no_run_trains_and_tests_and_every_fold_tests(seed):
    rng = np.random.default_rng(seed)
    rows = [(f"m{m}", f"m{m}/run{r}") for m in range(3) for r in range(5) for _ in range(rng.integers(1, 12))]
    table = pd.DataFrame(rows, columns=["material", "session"]).assign(operator=None, repetition=None)
    table["recording_id"] = [f"r{i}" for i in range(len(table))]
    splits = find_protocol("run").split(table, 5, seed)
    assert len(splits) == 5
    for train, test in splits:
        assert not set(table["session"][train]) & set(table["session"][test])
        assert set(table["material"][train]) == {"m0", "m1", "m2"}


def test_without_sessions_a_run_is_a_recording():
    assert find_protocol("run").clusters(a_table()).tolist() == a_table()["recording_id"].tolist()


@pytest.mark.parametrize("name", ["recording", "run", "paper"])
def test_repeats_are_the_splits_of_the_next_seeds(name):
    protocol = find_protocol(name)
    repeats = repeated(protocol, a_table(), 5, 3, 7)
    for r, splits in enumerate(repeats):
        for (_, found), (_, plain) in zip(splits, protocol.split(a_table(), 5, 7 + r), strict=True):
            assert found.tolist() == plain.tolist()
    assert repeats[0][0][1].tolist() != repeats[1][0][1].tolist()


@pytest.mark.parametrize(("name", "n"), [("recording", 0), ("blocks", 2), ("few-shot", 3), ("operator", 2)])
def test_what_splits_in_one_way_is_not_repeated(name, n):
    with pytest.raises(ValueError, match=f"{n} repeats of the protocol `{name}`; the rule is 1"):
        repeated(find_protocol(name), a_table(), 5, n, 0)


def test_splits_follow_the_seed():
    split = find_protocol("recording").split
    first = [test.tolist() for _, test in split(a_table(), 10, 0)]
    assert first == [test.tolist() for _, test in split(a_table(), 10, 0)]
    assert first != [test.tolist() for _, test in split(a_table(), 10, 1)]


def test_only_the_paper_protocol_is_not_nested():
    assert [p.name for p in PROTOCOLS.values() if not p.nested] == ["paper"]


@pytest.mark.parametrize(
    ("name", "table", "message"),
    [
        (
            "recording",
            a_table(3, 10).iloc[9:],
            "material m0 has 1 recording; 10 folds need at least 10 of each",
        ),
        ("recording", a_table(1, 10), "1 material; classification needs at least 2"),
        ("recording", a_table(2, 7), "7 recordings; 10 folds need at least 10 of each; 2 to 7 folds are"),
        ("run", a_table(2, 7), "material m0 has 7 runs; 10 folds .* at least 10 of each; 2 to 7 folds are"),
        (
            "run",
            a_table().assign(session=["a", "b", "c"] * 10),
            "has 3 runs; 10 folds grouped by run need at least 10",
        ),
        ("few-shot", a_table(3, 5), "material m0 has 5 recordings; the protocol `few-shot` needs 6 of each"),
        ("few-shot", a_table(repetition=None), "no repetition number; the protocol `few-shot` needs it"),
        ("operator", a_table(operator=None), "0 operators and 0 sessions"),
        ("operator", a_table(operator="o1"), "1 operators and 0 sessions"),
        (
            "operator",
            a_table(3, 1, operator=["a", "b", "b"]),
            "material m0 has no recording without operator a",
        ),
        ("blocks", a_table(3, 1), "material m0 has 1 recording"),
        ("blocks", a_table(repetition=None), "recording m0_1 has no repetition number"),
    ],
)
def test_an_impossible_split_names_value_and_rule(name, table, message):
    with pytest.raises(ValueError, match=message):
        find_protocol(name).split(table.reset_index(drop=True), 10, 0)


def test_an_unknown_protocol_lists_the_known_ones():
    with pytest.raises(ValueError, match="recording, operator, blocks, few-shot, run, paper"):
        find_protocol("random")
