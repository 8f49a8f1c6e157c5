"""Recordings to and from MNE, xarray and aeon; stand-ins where MNE is not installed."""

from types import SimpleNamespace

import numpy as np
import pytest

import texclass as tx
from texclass.loaders import collection_of, recordings_of
from texclass.recording import RecordingError

FS = 1000.0
AXES = np.random.default_rng(0).standard_normal((2, 3, 2000))
"""Two epochs, three axes."""
WHOLE = tx.Phases(movement=(0, 2000))


def stand_in(data, **facts):
    """Make what offers as much of MNE as is asked for."""
    return SimpleNamespace(get_data=lambda: data, info={"sfreq": FS}, ch_names=["ax", "ay", "az"], **facts)


def of_mne():
    """Make `Raw` and `Epochs` of MNE itself."""
    mne = pytest.importorskip("mne")
    info = mne.create_info(["ax", "ay", "az"], FS, "misc")
    events = np.column_stack(([0, 5000], [0, 0], [7, 3]))
    raw = mne.io.RawArray(AXES[0], info, verbose="error")
    return raw, mne.EpochsArray(AXES, info, events, event_id={"felt": 3, "oak": 7}, verbose="error")


def of_stand_ins():
    events = np.array([[0, 0, 7], [5000, 0, 3]])
    return stand_in(AXES[0]), stand_in(AXES, events=events, event_id={"felt": 3, "oak": 7})


@pytest.mark.parametrize("make", [of_mne, of_stand_ins])
def test_raw_and_epochs_are_recordings_of_their_channels(make):
    raw, epochs = make()
    (one,) = recordings_of(raw, unit="g")
    assert (one.fs, one.unit, one.channels, one.phases) == (FS, "m/s^2", ("ax", "ay", "az"), None)
    np.testing.assert_allclose(one.acceleration, 9.80665 * AXES[0].T)
    assert tx.extract(raw, unit="g").equals(tx.extract(one))
    epoch_recordings = recordings_of(epochs)
    assert [(r.recording_id, r.surface) for r in epoch_recordings] == [
        ("epoch 0", "oak"),
        ("epoch 1", "felt"),
    ]
    np.testing.assert_array_equal(tx.extract(epochs, "strese2015"), tx.extract(AXES, "strese2015", fs=FS))
    with pytest.raises(ValueError, match="fs is 1000 Hz, but 500 Hz was given"):
        tx.extract(raw, fs=500.0)


@pytest.mark.parametrize("acceleration", [AXES[0].T, AXES[0, 0]])
def test_a_recording_comes_back_from_xarray(acceleration):
    pytest.importorskip("xarray")
    before = tx.Recording(acceleration, FS, "g", "oak_1", "oak", session="2", repetition=3, native_fs=500.0)
    as_array = before.to_xarray()
    assert as_array.time.attrs == {"units": "s"}
    assert float(as_array.time[-1]) == 1.999
    as_array.attrs.pop("fs")  # the times tell
    (after,) = recordings_of(as_array.T)
    groups = ("surface", "operator", "session", "repetition")
    for name in ("fs", "native_fs", "unit", "channels", "recording_id", *groups):
        assert getattr(after, name) == getattr(before, name)
    np.testing.assert_array_equal(after.acceleration, before.acceleration)
    assert tx.extract(as_array).equals(tx.extract(before))
    with pytest.raises(ValueError, match="500 Hz was given"):
        recordings_of(as_array, fs=500.0)


def test_times_of_xarray_may_be_differences_and_further_dimensions_are_refused():
    xarray = pytest.importorskip("xarray")
    times = np.arange(2000) * np.timedelta64(1_000_000, "ns")
    x = xarray.DataArray(AXES[0, 0], {"time": times}, name="x")
    assert recordings_of(x)[0].fs == FS
    for wrong in (x.expand_dims(["a", "b"]), x.rename(time="t")):
        with pytest.raises(RecordingError, match=r"x: its dimensions are .* Expected `time` and at most one"):
            recordings_of(wrong)


def test_a_collection_for_aeon_has_axes_before_samples_and_is_read_back():
    equal = [tx.Recording(x.T, FS, phases=WHOLE) for x in AXES]
    np.testing.assert_array_equal(collection_of(equal), AXES)
    unequal = [equal[0], tx.Recording(AXES[1, 0, :900], FS, phases=tx.Phases(movement=(0, 900)))]
    collection = collection_of(unequal)
    assert [case.shape for case in collection] == [(3, 2000), (1, 900)]
    with pytest.raises(ValueError, match="1 axis, but row 0 has 3 axes"):
        tx.extract(collection, "strese2015", fs=FS)
    longer = [equal[0], tx.Recording(AXES[1, :, :900].T, FS, phases=tx.Phases(movement=(0, 900)))]
    np.testing.assert_array_equal(
        tx.extract(collection_of(longer), "strese2015", fs=FS), tx.extract(longer, "strese2015")
    )
