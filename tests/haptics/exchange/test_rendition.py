"""Conversion of surfaces to files for other devices and back."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_hjif import TAPS, lines, noise, ridges

from texclass.haptics.exchange import (
    play_taps,
    play_texture,
    read_hjif,
    to_rendition,
    to_texture,
    write_hjif,
)
from texclass.haptics.exchange.hjif_rendition import build_hjif
from texclass.haptics.exchange.rendition import Rendition, level_db
from texclass.vibration.scores import band_energy_distance, goodness_of_fit


def round_trip(rendition, path):
    """Return the texture and the losses of a rendition after writing and reading it as .hjif."""
    write_hjif(rendition, path)
    return to_texture(to_rendition(read_hjif(path)))


def test_lines_keep_frequency_amplitude_and_phase(tmp_path):
    rendition = play_texture(lines(), speed=70.0, seconds=1.0)
    texture, losses = round_trip(rendition, tmp_path / "a.hjif")
    model = texture.at(70.0)
    order = np.argsort(model.frequency_hz)
    assert (texture.family, texture.name) == ("oeztuerk2018-frequencies", "sieve")
    assert_allclose(model.frequency_hz[order], rendition.lines[:, 0])  # 40, 220, 400: whole
    assert_allclose(model.amplitude[order], rendition.lines[:, 1], rtol=1e-9)
    phase_error = model.phase[order] - rendition.lines[:, 2]
    assert_allclose(np.cos(phase_error), 1.0, atol=1e-8)
    assert "70 mm/s" in losses["speed and force"]


def test_taps_keep_peak_and_frequency_but_not_their_decay(tmp_path):
    rendition = play_taps(TAPS)
    library, losses = round_trip(rendition, tmp_path / "a.hjif")
    assert_allclose(play_taps(library).taps, rendition.taps, rtol=1e-6)
    assert set(losses) == {"decay", "names"}


def test_noise_keeps_spectrum_level_and_friction(tmp_path, slate):
    for source in (slate, noise()):
        original = play_texture(source, seconds=4.0)
        texture, losses = round_trip(original, tmp_path / "a.hjif")
        result = play_texture(texture, speed=original.speed, force=original.force, seconds=4.0, seed=3)
        assert (texture.family, texture.fs) == ("hatt", source.fs)
        assert texture.mu == pytest.approx(original.friction, abs=1e-6)
        assert goodness_of_fit(original.samples, result.samples) > 0.95
        assert band_energy_distance(original.samples, result.samples, source.fs) < 2.0
        assert level_db(result.samples) == pytest.approx(level_db(original.samples), abs=0.7)
        assert "order 30" in losses["waveform"]


def test_spatial_textures_keep_their_spectrum(tmp_path):
    original = play_texture(ridges(), speed=50.0)
    texture, losses = round_trip(original, tmp_path / "a.hjif")
    assert texture.fs == pytest.approx(1000.0, rel=0.01)
    result = play_texture(texture, speed=50.0, force=1.0, seconds=4.0)
    peaks = [
        np.argmax(np.abs(np.fft.rfft(x, 4000))) / 4000 * f
        for x, f in ((original.samples, 1000.0), (result.samples, texture.fs))
    ]
    assert peaks[0] == pytest.approx(peaks[1], abs=12.0)
    assert "position" in losses


def test_files_of_other_programs_get_the_nominal_speed_and_force(tmp_path):
    write_hjif(play_texture(noise(), seconds=1.0), tmp_path / "a.hjif")
    haptics = read_hjif(tmp_path / "a.hjif")
    for description in ("rumble", "a at 1e999 mm/s, V", "a at 3 mm/s, 1 N, furlongs", "a at nan mm/s, V"):
        perception = haptics.perceptions[0].model_copy(update={"description": description})
        rendition = to_rendition(haptics.model_copy(update={"perceptions": (perception,)}))
        assert (rendition.speed, rendition.force, rendition.unit) == (100.0, 1.0, "arbitrary")


def test_silent_renditions_and_files_without_vibration_are_refused():
    silent = Rendition("silent", "m/s^2", 1000.0, np.zeros(500), 100.0, 1.0)
    for x in (np.zeros(500), np.ones(500), np.ones(9), np.array([1e308, -1e308] * 250)):
        with pytest.raises(ValueError, match="not be silent"):
            to_texture(replace(silent, samples=x))
    haptics, _ = build_hjif(play_texture(noise(), seconds=0.6))
    force = haptics.perceptions[0].model_copy(update={"perception_modality": "Force"})
    with pytest.raises(ValueError, match="Vibrotactile"):
        to_rendition(haptics.model_copy(update={"perceptions": (force,)}))
