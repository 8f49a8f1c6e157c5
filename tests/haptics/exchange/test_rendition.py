"""What comes back of a surface that was written for another device."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_hjif import TAPS, lines, noise, ridges

from texclass.haptics.exchange import (
    play_taps,
    play_texture,
    read_hjif,
    rendition_of,
    texture_of,
    write_hjif,
)
from texclass.haptics.exchange.hjif_rendition import made_hjif
from texclass.haptics.exchange.rendition import Rendition, level_db
from texclass.vibration.scores import band_energy_distance, goodness_of_fit


def back(sent, path):
    """Return the texture, and what is lost, of a rendition that was written as .hjif."""
    write_hjif(sent, path)
    return texture_of(rendition_of(read_hjif(path)))


def test_lines_come_back_with_frequency_amplitude_and_phase(tmp_path):
    sent = play_texture(lines(), speed=70.0, seconds=1.0)
    texture, lost = back(sent, tmp_path / "a.hjif")
    found = texture.at(70.0)
    order = np.argsort(found.frequency_hz)
    assert (texture.family, texture.name) == ("oeztuerk2018-frequencies", "sieve")
    assert_allclose(found.frequency_hz[order], sent.lines[:, 0])  # 40, 220, 400: whole
    assert_allclose(found.amplitude[order], sent.lines[:, 1], rtol=1e-9)
    turn = found.phase[order] - sent.lines[:, 2]
    assert_allclose(np.cos(turn), 1.0, atol=1e-8)
    assert "70 mm/s" in lost["speed and force"]


def test_taps_come_back_with_peak_and_frequency_but_not_their_decay(tmp_path):
    sent = play_taps(TAPS)
    library, lost = back(sent, tmp_path / "a.hjif")
    again = play_taps(library)
    assert_allclose(again.taps, sent.taps, rtol=1e-6)
    assert set(lost) == {"decay", "names"}


def test_noise_comes_back_with_spectrum_level_and_friction(tmp_path, slate):
    for source in (slate, noise()):
        sent = play_texture(source, seconds=4.0)
        texture, lost = back(sent, tmp_path / "a.hjif")
        again = play_texture(texture, speed=sent.speed, force=sent.force, seconds=4.0, seed=3)
        assert (texture.family, texture.fs) == ("hatt", source.fs)
        assert texture.mu == pytest.approx(sent.friction, abs=1e-6)
        assert goodness_of_fit(sent.samples, again.samples) > 0.95
        assert band_energy_distance(sent.samples, again.samples, source.fs) < 2.0
        assert level_db(again.samples) == pytest.approx(level_db(sent.samples), abs=0.7)
        assert "order 30" in lost["waveform"]


def test_what_repeats_along_a_surface_comes_back_as_its_spectrum(tmp_path):
    sent = play_texture(ridges(), speed=50.0)
    texture, lost = back(sent, tmp_path / "a.hjif")
    assert texture.fs == pytest.approx(1000.0, rel=0.01)
    again = play_texture(texture, speed=50.0, force=1.0, seconds=4.0)
    peaks = [
        np.argmax(np.abs(np.fft.rfft(x, 4000))) / 4000 * f
        for x, f in ((sent.samples, 1000.0), (again.samples, texture.fs))
    ]
    assert peaks[0] == pytest.approx(peaks[1], abs=12.0)
    assert "place" in lost


def test_a_file_of_others_is_taken_for_a_usual_stroke(tmp_path):
    write_hjif(play_texture(noise(), seconds=1.0), tmp_path / "a.hjif")
    haptics = read_hjif(tmp_path / "a.hjif")
    for told in ("rumble", "a at 1e999 mm/s, V", "a at 3 mm/s, 1 N, furlongs", "a at nan mm/s, V"):
        felt = haptics.perceptions[0].model_copy(update={"description": told})
        found = rendition_of(haptics.model_copy(update={"perceptions": (felt,)}))
        assert (found.speed, found.force, found.unit) == (100.0, 1.0, "arbitrary")


def test_silence_and_no_vibration_are_refused():
    still = Rendition("still", "m/s^2", 1000.0, np.zeros(500), 100.0, 1.0)
    for x in (np.zeros(500), np.ones(500), np.ones(9), np.array([1e308, -1e308] * 250)):
        with pytest.raises(ValueError, match="not silent"):
            texture_of(replace(still, samples=x))
    haptics, _ = made_hjif(play_texture(noise(), seconds=0.6))
    felt = haptics.perceptions[0].model_copy(update={"perception_modality": "Force"})
    with pytest.raises(ValueError, match="Vibrotactile"):
        rendition_of(haptics.model_copy(update={"perceptions": (felt,)}))
