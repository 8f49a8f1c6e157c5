"""Tables that are cached apart."""

import numpy as np
import pytest

from texclass.experiment.extraction import cached_table
from texclass.experiment.joined import cached_tables


@pytest.fixture
def parts(feature_set):
    return feature_set.restricted_to(["level", "knock", "rarely"]), feature_set.restricted_to(["peaks"])


def test_joined_tables_hold_what_one_table_holds(toy_dataset, feature_set, parts):
    whole, joined = cached_table(toy_dataset(), feature_set), cached_tables(toy_dataset(), parts)
    assert joined.columns == ("level", "knock", "rarely", "peaks.second", "peaks.first")
    np.testing.assert_array_equal(joined.frame[list(whole.columns)], whole.values)
    assert list(joined.frame["recording_id"]) == list(whole.frame["recording_id"])
    assert sorted(joined.reasons) == sorted(whole.reasons)
    assert joined.flags == whole.flags
    assert joined.ms.shape == whole.ms.shape


def test_only_the_part_that_is_new_is_computed(toy_dataset, parts):
    cached_table(toy_dataset(), parts[0])
    dataset = toy_dataset()
    cached_tables(dataset, parts)
    assert len(dataset.load.loaded) == len(dataset)
    cached_tables(dataset, parts)
    assert len(dataset.load.loaded) == len(dataset)


def test_a_bad_recording_is_left_out_once(toy_dataset, parts):
    joined = cached_tables(toy_dataset(bad=("m1_3",)), parts, skip_bad=True)
    assert [item.recording_id for item in joined.left_out] == ["m1_3"]
    assert joined.n_recordings == 11
