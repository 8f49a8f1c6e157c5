import numpy as np
import pytest

from texclass.recording import STANDARD_GRAVITY, Phases, Recording, RecordingError, Tap, make_read_only

SIGNAL = np.sin(np.arange(100.0))


def recording(**changes):
    return Recording(**{"acceleration": SIGNAL, "fs": 1000.0, "unit": "m/s^2", "recording_id": "r"} | changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        *(({"fs": fs}, "fs is .*Expected a positive sampling rate in Hz") for fs in (0, -1, None, "fast")),
        *(({"fs": fs}, "fs is .*Expected a positive sampling rate in Hz") for fs in (np.nan, np.inf)),
        ({"unit": "m/s"}, r"unknown unit 'm/s'. Expected one of m/s\^2"),
        *(
            ({"acceleration": np.where(np.arange(100) == 7, bad, SIGNAL)}, r"contains 1 NaN .*first at \[7\]")
            for bad in (np.nan, np.inf, -np.inf)
        ),
        ({"acceleration": ["1", "two"]}, "not a number"),
        ({"acceleration": SIGNAL.reshape(-1, 2), "channels": ("x", "x")}, "2 different names"),
        ({"friction": SIGNAL[:-1]}, "friction has 99 samples, but acceleration has 100"),
    ],
)
def test_an_invalid_recording_is_an_error_with_value_and_expectation(changes, message):
    with pytest.raises(RecordingError, match=message):
        recording(**changes)


@pytest.mark.parametrize(("unit", "factor"), [("g", STANDARD_GRAVITY), ("mg", STANDARD_GRAVITY / 1000)])
def test_physical_units_become_metres_per_second_squared(unit, factor):
    converted = recording(unit=unit)
    assert converted.unit == "m/s^2"
    np.testing.assert_allclose(converted.acceleration, SIGNAL * factor, rtol=1e-15)


def test_a_copy_is_not_converted_again():
    once = recording(unit="g")
    np.testing.assert_array_equal(once.with_(surface="wood").acceleration, once.acceleration)


@pytest.mark.parametrize("unit", ["counts", "V", "arbitrary"])
def test_scaleless_units_are_kept(unit):
    assert recording(unit=unit).unit == unit


def test_the_arrays_are_read_only_copies():
    own = SIGNAL.copy()
    made = recording(acceleration=own)
    own[0] = 5
    assert made.acceleration[0] == SIGNAL[0]
    with pytest.raises(ValueError, match="read-only"):
        made.acceleration[0] = 1


@pytest.mark.parametrize(("n", "names"), [(3, ("x", "y", "z")), (2, ("c1", "c2"))])
def test_channels_have_default_names(n, names):
    assert recording(acceleration=np.column_stack([SIGNAL] * n)).channels == names


def test_duration_is_samples_by_rate():
    assert recording().duration_s == pytest.approx(0.1)


@pytest.mark.parametrize("indices", [(-1, 0, 1), (2, 1, 3), (0, 3, 3)])
def test_a_tap_is_in_order_of_time(indices):
    with pytest.raises(ValueError, match="start <= impact < end"):
        Tap(*indices)


@pytest.mark.parametrize(
    ("phases", "kind"),
    [
        (Phases(), "nothing"),
        (Phases(taps=(Tap(0, 1, 2),)), "taps only"),
        (Phases(movement=(0, 9)), "movement only"),
        (Phases(taps=(Tap(0, 1, 2),), movement=(3, 9)), "taps and movement"),
    ],
)
def test_the_kind_of_phases_is_given_in_words(phases, kind):
    assert phases.kind == kind


def test_a_copy_without_changes_is_the_recording_itself():
    made = recording(surface="wood", phases=Phases(movement=(0, 9)))
    assert made.with_(phases=made.phases, surface="wood") is made
    assert made.with_(surface="cork").surface == "cork"
    assert made.surface == "wood"
    with pytest.raises(TypeError, match="n_samples"):
        made.with_(n_samples=made.n_samples)


def test_a_read_only_array_is_not_copied():
    own = make_read_only(SIGNAL.copy().reshape(-1, 2))
    made = recording(acceleration=own)
    assert made.acceleration is own
    assert made.with_(surface="wood").acceleration is own
    assert not own.base.flags.writeable
    view = SIGNAL.copy()[:50]
    view.flags.writeable = False  # what it is a view of can still be written to
    assert recording(acceleration=view).acceleration is not view


def test_samples_and_a_rate_are_enough():
    bare = Recording(SIGNAL, fs=1000.0)
    assert (bare.unit, bare.recording_id, bare.channels) == ("arbitrary", "recording", ("c1",))


def test_a_recording_is_shown_in_one_line_and_as_a_table():
    oak = recording(recording_id="oak_1", surface="<oak>", friction=SIGNAL)
    assert repr(oak) == "<Recording 'oak_1' of <oak>: 0.1 s at 1000 Hz, 1 axis in m/s^2>"
    table = oak._repr_html_()
    assert "<td>&lt;oak&gt;</td>" in table
    assert "<th>other signals</th><td>friction</td>" in table
    assert "operator" not in table
