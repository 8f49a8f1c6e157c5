import numpy as np
import pytest

from texclass.textures.guruswamy2011 import Amplitude, LevelLaw, fit_level_law
from texclass.textures.guruswamy2011.fit import normalised, scan_level, smoothed_path
from texclass.textures.scan import Scan

LAW = LevelLaw(k_v=18.5, k_c=0.117, a_0=0.435)


def steady(rms: float, speed: float, force: float, n: int = 2000) -> Scan:
    tone = np.sqrt(2) * rms * np.sin(2 * np.pi * 50 * np.arange(n) / 500)
    return Scan.along_line(tone, speed, force, 500.0, "tone")


def scans(law: LevelLaw, k: int = 6) -> list[Scan]:
    speeds, forces = np.linspace(10, 80, k), np.array([0.3, 0.9, 0.5, 1.2, 0.4, 0.7])[:k]
    return [steady(float(law.rms(v, f)), v, f) for v, f in zip(speeds, forces, strict=True)]


def test_regression_finds_a_known_law():
    for k_c in (0.117, None):
        fit = fit_level_law(scans(LAW), k_c)
        assert fit.law.k_v == pytest.approx(18.5, rel=1e-3)
        assert fit.law.k_c == pytest.approx(0.117, rel=2e-2)
        assert fit.law.a_0 == pytest.approx(0.435, rel=2e-3)
        assert fit.r_squared > 0.9999
    assert LAW.rms(21.6, 0.443) == pytest.approx(18.5 * 0.0216 + 0.117 * 0.443 + 0.435)


def test_a_linear_drift_does_not_count_as_vibration():
    scan = steady(1.0, 20.0, 0.5)
    drifting = Scan.along_line(scan.acceleration + np.linspace(0, 5, len(scan)), 20.0, 0.5, 500.0)
    assert scan_level(drifting)[2] == pytest.approx(1.0, rel=1e-3)


def test_factors_never_come_out_negative():
    falling = [steady(rms, v, 0.5) for rms, v in ((2.0, 10.0), (1.0, 40.0), (0.5, 80.0))]
    law = fit_level_law(falling, 0.0).law
    assert law.k_v == 0
    assert law.a_0 > 0


def test_scans_of_one_speed_and_impossible_factors_are_refused():
    with pytest.raises(ValueError, match="differ in speed"):
        fit_level_law([steady(1.0, 20.0, 0.5)] * 3, 0.1)
    for values in ((-1, 0, 1), (0, 0, 0), (np.nan, 0, 1)):
        with pytest.raises(ValueError, match="the rule is"):
            LevelLaw(*values)


def test_amplitude_is_the_ratio_of_levels_limited_and_if_compensated_less_by_the_root_of_speed():
    printed, ours = (Amplitude(LAW, 20.0, 0.4, compensated=c).factor(80.0, 0.4) for c in (False, True))
    assert printed == pytest.approx(LAW.rms(80, 0.4) / LAW.rms(20, 0.4))
    assert ours == pytest.approx(printed / 2)
    slow = [Amplitude(LAW, 20.0, 0.4, compensated=c).factor(5.0, 0.4) for c in (False, True)]
    assert slow[0] == slow[1]
    assert Amplitude(LAW, 21.6, 0.443).factor(21.6, 0.443) == pytest.approx(1.0)
    assert Amplitude(LAW, 20.0, 0.4, compensated=False).factor(1e8, 1e8) == 4.0


def test_normalising_undoes_what_speed_and_force_do():
    n = 4000
    force = 0.5 + 0.2 * np.sin(2 * np.pi * 0.5 * np.arange(n) / 500)
    law = LevelLaw(0.0, 1.0, 0.1)
    tone = np.sin(2 * np.pi * 60 * np.arange(n) / 500)
    scan = Scan.along_line(tone * law.rms(20.0, force) / law.rms(20.0, 0.5), 20.0, force, 500.0)
    found = normalised(scan, Amplitude(law, 20.0, 0.5))
    assert np.abs(found - tone)[200:-200].max() < 0.01


def test_smoothed_path_drops_what_no_hand_does():
    scan = Scan.along_line(np.zeros(2000), 20.0, 1 + np.sin(2 * np.pi * 100 * np.arange(2000) / 500), 500.0)
    _, force = smoothed_path(scan)
    assert np.abs(force - 1)[100:-100].max() < 0.01
