"""The picture of one recording: every kind of phases, short recordings, hostile names."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from texclass.phases import segment
from texclass.recording import Phases, Recording, Tap
from texclass.reporting.inspection import draw_inspection


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
        assert "no feature values" in _drawn(recording, segment(recording), None)


def test_legends_stand_clear_of_the_data():
    phases = Phases(taps=(Tap(3000, 3500, 3700),), movement=(10_000, 20_000), onset=10_000)
    figure = draw_inspection(_recording(), phases, None)
    FigureCanvasAgg(figure).draw()
    legends = [(axes, axes.get_legend()) for axes in figure.axes if axes.get_legend()]
    assert len(legends) == 2
    for axes, legend in legends:
        assert legend.get_window_extent().y0 >= axes.get_window_extent().y1


def test_names_are_drawn_in_full_with_the_unit_of_the_recording_and_dollars_are_no_mathematics():
    recording = _recording(material="a $b_{c$ d", flags=("clipped: 3 %",) * 9).with_(unit="counts")
    values = {"spikiness": 2.0, "line_spectral_frequencies.c12": 1.0}
    values |= {f"a_long_name_of_a_feature.${i}": 10.0**i for i in range(98)}
    texts = _drawn(recording, Phases(), values, {"spikiness": "log10(m/s^2)"})
    assert {"line_spectral_frequencies.c12", "log10(counts)", "and 61 more"} <= set(texts)
    assert sum("a $b_{c$ d" in text for text in texts) == 1
