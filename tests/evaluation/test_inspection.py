"""The figure of one recording: all kinds of phases, short recordings, special characters in names."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from texclass.evaluation.inspection import draw_inspection
from texclass.phases import find_phases
from texclass.recording import Phases, Recording, Tap


def _recording(n=20_000, n_axes=3, fs=10_000.0, **facts):
    rng = np.random.default_rng(0)
    x = 0.02 * rng.standard_normal((n, n_axes))
    x[n // 2 :] += rng.standard_normal((n - n // 2, n_axes))
    return Recording(x if n_axes > 1 else x[:, 0], fs, "m/s^2", "made", **facts)


def _drawn(recording, phases, values, units=None):
    """Return the shown texts of a picture with something in it."""
    figure = draw_inspection(recording, phases, values, units)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3] / 255
    assert pixels.std() > 0.05
    return [text.get_text() for text in figure.findobj(Text)]


@pytest.mark.parametrize(
    ("phases", "said"),
    [
        (Phases(taps=(Tap(3000, 3500, 3700), Tap(5000, 5500, 5700)), movement=(10_000, 20_000), onset=10_000),
         ["hand", "impact, decay", "movement", "onset of sliding", "tap", "Tap 2 of 2", "contact"]),
        (Phases(taps=(Tap(0, 0, 20_000),)), ["hand", "Tap 1 of 1"]),
        (Phases(movement=(0, 20_000)), ["movement", "no tap in this recording"]),
        (Phases(notes=("neither taps nor movement",)), ["no tap in this recording"]),
    ],
)  # fmt: skip
def test_every_kind_of_phases_is_drawn(phases, said):
    values = {"hardness": 3.2, "damping": float("nan")}
    texts = _drawn(_recording(n_axes=3 if phases.taps else 1), phases, values)
    assert {*said, "hardness", "3.2", "undefined"} <= set(texts)
    assert texts.count("hand") == 2 * ("hand" in said)  # in the legend of the signal, and of the tap
    assert texts.count("movement") == ("movement" in said)


def test_short_and_constant_recordings_are_drawn():
    for n in (1, 40):
        recording = Recording(np.full(n, 9.81), 1000.0, "counts", "short")
        assert "no feature values" in _drawn(recording, find_phases(recording), None)


def test_legends_stand_clear_of_the_data():
    phases = Phases(taps=(Tap(3000, 3500, 3700),), movement=(10_000, 20_000), onset=10_000)
    figure = draw_inspection(_recording(), phases, None)
    FigureCanvasAgg(figure).draw()
    legends = [(axes, axes.get_legend()) for axes in figure.axes if axes.get_legend()]
    assert len(legends) == 2
    for axes, legend in legends:
        assert legend.get_window_extent().y0 >= axes.get_window_extent().y1


def test_names_are_drawn_in_full_with_the_unit_of_the_recording_and_dollars_are_no_mathematics():
    recording = _recording(surface="a $b_{c$ d", flags=("clipped: 3 %",) * 9).with_(unit="counts")
    values = {"spikiness": 2.0, "line_spectral_frequencies.c12": 1.0}
    values |= {f"a_long_name_of_a_feature.${i}": 10.0**i for i in range(98)}
    texts = _drawn(recording, Phases(), values, {"spikiness": "log10(m/s^2)"})
    assert {"line_spectral_frequencies.c12", "log10(counts)", "and 61 more"} <= set(texts)
    assert sum("a $b_{c$ d" in text for text in texts) == 1


def _axes(figure, title):
    return next(axes for axes in figure.axes if axes.get_title(loc="left").startswith(title))


def test_the_spectrogram_says_where_a_recording_is_too_short_for_it():
    for n, is_short in ((7, True), (8, False)):
        recording = Recording(np.arange(float(n)), 1000.0, "counts", "short")
        figure = draw_inspection(recording, Phases(), None)
        below = _axes(figure, "Spectrogram")
        assert ("too short" in [text.get_text() for text in below.texts]) == is_short
        assert bool(below.images) != is_short


def test_the_spectrogram_shows_a_tone_at_its_frequency_over_the_whole_recording():
    fs, n = 2000.0, 4000
    tone = Recording(np.sin(2 * np.pi * 500 * np.arange(n) / fs), fs, "m/s^2", "tone")
    below = _axes(draw_inspection(tone, Phases(), None), "Spectrogram")
    image = below.images[0]
    first, last, low, high = image.get_extent()
    power = image.get_array()
    row = int(power[:, power.shape[1] // 2].argmax())
    assert low + (row + 0.5) * (high - low) / len(power) == pytest.approx(500, abs=fs / 2 / len(power))
    assert (below.get_xlim(), below.get_ylim()) == ((0.0, n / fs), (0.0, fs / 2))
    assert first <= 0.0
    assert last >= 0.9 * n / fs
    assert image.get_clim()[1] - image.get_clim()[0] == pytest.approx(70.0)  # dB


def test_phases_are_drawn_at_their_times_and_the_tap_of_median_strength_around_its_contact():
    recording = _recording(n_axes=1)
    x = recording.acceleration.copy()
    taps = tuple(Tap(at - 500, at, at + 200) for at in (2000, 4000, 6000))
    for tap, strength in zip(taps, (30.0, 50.0, 40.0), strict=True):
        x[tap.impact] = strength
    phases = Phases(taps=taps, movement=(10_000, 20_000), onset=11_000)
    figure = draw_inspection(recording.with_(acceleration=x), phases, None)
    above, shown = _axes(figure, "Signal"), _axes(figure, "Tap 3 of 3")
    lines = {line.get_label(): line.get_xdata() for line in above.lines}
    np.testing.assert_allclose(lines["tap"], [0.2, 0.4, 0.6])
    np.testing.assert_allclose(lines["onset of sliding"], 1.1)
    spans = {patch.get_label(): (patch.get_x(), patch.get_width()) for patch in above.patches}
    assert spans["movement"] == pytest.approx((1.0, 1.0))
    assert spans["hand"] == pytest.approx((0.15, 0.05))
    ms, values = shown.lines[0].get_data()
    assert ms[np.argmax(values)] == pytest.approx(0.0)
    assert values.max() == pytest.approx(40.0, abs=0.05)  # the mean is removed
    assert (ms[0], ms[-1]) == pytest.approx((-50 - 21.1, 20 + 21.0))  # 0.3 of the tap before and after it
    assert "m/s²" in above.get_ylabel()
    assert "m/s²" in shown.get_ylabel()
