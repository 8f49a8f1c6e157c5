"""Protocols: recordings are the unit, and an impossible split says why."""

import numpy as np
import pandas as pd
import pytest

from texclass.experiment.protocols import PROTOCOLS, find_protocol


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


@pytest.mark.parametrize("name", ["recording", "operator", "paper"])
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
    with pytest.raises(ValueError, match="recording, operator, blocks, paper"):
        find_protocol("random")
