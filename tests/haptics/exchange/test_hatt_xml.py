import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from test_families import K as SLATE
from test_families import frequencies, lpc, network

from texclass.haptics.exchange import hatt_xml, read_hatt, to_hatt, write_hatt
from texclass.haptics.textures.oeztuerk2018 import LpcTexture
from texclass.vibration import Autoregression, fit
from texclass.vibration.line_spectrum import from_reflection

K = {1: [-0.6, 0.4, -0.1], 2: [-0.5, 0.3, 0.2], 3: [0.1, 0.2, -0.3], 4: [0.0, -0.2, 0.5]}
MA = [0.3, -0.2]
POINTS = {1: (0.0, 0.0), 2: (120.0, 0.0), 3: (0.0, 4.0), 4: (120.0, 4.0)}


def _values(values, form):
    return "".join(f"<value>{value:{form}}</value>" for value in values)


def _part(name, k):
    model = Autoregression(k, np.array(1.0))
    lsf = from_reflection(k) if len(k) else []
    return (
        f"<{name}coeff>{_values(model.direct_form(), '.20f')}</{name}coeff>"
        f"<{name}lsf>{_values(lsf, '.6f')}</{name}lsf>"
    )


def _model(number):
    speed, force = POINTS[number]
    return (
        f"<model><modNum>{number}</modNum>{_part('AR', K[number])}{_part('MA', MA)}"
        f"<var>{0.01 * number:f}</var><gain>{1 + number:f}</gain>"
        f"<speedMod>{speed:f}</speedMod><forceMod>{force:f}</forceMod></model>"
    )


def _array(tag, values):
    return f'<{tag} type="array">{_values(values, "")}</{tag}>'


def document(order=(1, 2, 3, 4)):
    """Return a file in the layout of the published ones, with numbers rounded as there."""
    speeds, forces = zip(*POINTS.values(), strict=True)
    return "\n".join(
        [
            '<?xml version="1.0" encoding="utf-8"?>',
            '<modelSet texture="0"><material>Slate</material><AccelUnits>m/s^2</AccelUnits>',
            "<SpeedUnits>mm/s</SpeedUnits><ForceUnits>N</ForceUnits><SampleRate>1000</SampleRate>",
            "<mu>0.310000</mu><htmlPicture>slate.bmp</htmlPicture><renderPicture>slate.bmp</renderPicture>",
            "<numMod>4</numMod><numTri>2</numTri><maxSpeed>120.0</maxSpeed><maxForce>4.0</maxForce>",
            _array("speedList", speeds),
            _array("forceList", forces),
            _array("tri", [1, 2, 3]),
            _array("tri", [2, 4, 3]),
            "<DTpicture>tri.bmp</DTpicture><numARCoeff>3</numARCoeff><numMACoeff>2</numMACoeff>",
            *(_model(number) for number in order),
            "</modelSet>",
        ]
    )


@pytest.fixture
def write(tmp_path):
    def to_file(text):
        path = tmp_path / "Models_Slate.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return to_file


def assert_refused(path, match):
    with pytest.raises(ValueError, match=match) as error:
        read_hatt(path)
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 1000


def test_the_published_layout_is_read_in_any_order_with_exact_line_spectra(write):
    for order in ((1, 2, 3, 4), (4, 2, 1, 3)):
        texture = read_hatt(write(document(order)))
        assert (texture.name, texture.fs, texture.mu) == ("Slate", 1000.0, 0.31)
        assert_array_equal(texture.mesh.triangles, [[0, 1, 2], [1, 3, 2]])
        assert_array_equal(texture.mesh.speed, [0, 120, 0, 120])
        assert_array_equal(texture.mesh.force, [0, 0, 4, 4])
        assert_allclose(texture.variance, [0.01, 0.02, 0.03, 0.04])
        assert_allclose(texture.gain, [2, 3, 4, 5])
        assert_allclose(texture.ar_lsf, [from_reflection(K[i]) for i in (1, 2, 3, 4)], atol=1e-12)
        assert_allclose(texture.ma_lsf, [from_reflection(MA)] * 4, atol=1e-12)


def test_line_spectra_or_coefficients_or_an_ar_part_are_sufficient(write):
    expected = read_hatt(write(document()))
    for tag, tolerance in (("ARcoeff", 1e-6), ("MAcoeff", 1e-6), ("ARlsf", 1e-12), ("MAlsf", 1e-12)):
        texture = read_hatt(write(re.sub(f"<{tag}>.*?</{tag}>", "", document())))
        assert_allclose(texture.ar_lsf, expected.ar_lsf, atol=tolerance)
        assert_allclose(texture.ma_lsf, expected.ma_lsf, atol=tolerance)
    text = re.sub("<(numMACoeff|mu|material|AccelUnits|SpeedUnits|ForceUnits)>.*?</.*?>", "", document())
    texture = read_hatt(write(re.sub("<MA.*?</MAlsf>", "", text)))
    assert (texture.ma_order, texture.mu, texture.name) == (0, 0.0, "")
    assert_array_equal(texture.gain, 1.0)  # the gain is ignored without an MA part


def test_a_round_trip_is_exact_and_writes_the_published_elements(slate, tmp_path):
    path = write_hatt(slate, tmp_path / "slate.xml")
    loaded = read_hatt(path)
    assert loaded.parameters() == slate.parameters()
    for name, array in slate.arrays().items():
        assert_array_equal(loaded.arrays()[name], array, err_msg=name)
    published, written = (set(re.findall(r"<(\w+)", text)) for text in (document(), path.read_text()))
    assert published <= written
    assert written - published == {"htmlLinuxPicture", "LinuxDTpicture"}


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("<numMod>4<", "<numMod>5<", "speedList"),
        ("<numMod>4<", "<numMod>99999999999<", "count"),
        ("<numMod>4<", "<numMod>1.5<", "count"),
        ("<numMod>4</numMod>", "", "no <numMod>"),
        ("<numTri>2<", "<numTri>3<", "numTri is 3"),
        ("<numARCoeff>3<", "<numARCoeff>4<", "ARlsf"),
        ("<numMACoeff>2<", "<numMACoeff>1<", "MAlsf"),
        ("<SampleRate>1000<", "<SampleRate>0<", "fs must be positive and finite, got 0.0"),
        ("<AccelUnits>m/s^2<", "<AccelUnits>g<", "AccelUnits"),
        ("<mu>0.310000<", "<mu>-1<", "mu must be"),
        ("<var>0.010000<", "<var>nan<", "finite number"),
        ("<gain>2.000000</gain>", "<gain>2</gain><gain>2</gain>", "2 <gain>"),
        ("<value>1</value><value>2</value>", "<value>1</value><value>9</value>", "got 8"),
        ("<value>1</value><value>2</value>", "<value>1</value><value>1</value>", "a positive area"),
        ("<value>1</value><value>2</value>", "<value>1</value>", "values"),
        ("<speedMod>120.000000<", "<speedMod>77.0<", "speedList"),
        ("<material>Slate<", "<material>Sl&#x7f;ate<", "printable"),
        ("<modNum>1</modNum>", "<modNum>1<b><c/></b></modNum><var>1</var>", "2 <var>"),
        ("modelSet", "set", "modelSet"),
        ("</modelSet>", "", "well formed"),
        ("Slate", "&slate;", "well formed"),
    ],
)
def test_invalid_files_are_refused(write, old, new, match):
    assert old in document()
    assert_refused(write(document().replace(old, new)), match)


@pytest.mark.parametrize(
    ("part", "form", "values", "match"),
    [
        ("ARcoeff", ".20f", [1, -2.5, 0.1, 0.3], "model '1': AR: reflection coefficients"),
        ("ARcoeff", ".20f", [2, 0, 0, 0], "model '1': AR: coefficients"),
        ("ARlsf", ".6f", [0.5, 1.0, 2.0], "differ by"),
        ("ARlsf alone", ".6f", [2.0, 1.0, 0.5], "stable"),
    ],
)
def test_models_that_are_not_stable_or_contradictory_are_refused(write, part, form, values, match):
    text, (tag, *option) = document(), part.split()
    if option:
        text = re.sub("<ARcoeff>.*?</ARcoeff>", "", text)
    inner = re.search(f"<{tag}>(.*?)</{tag}>", text)[1]
    assert_refused(write(text.replace(inner, _values(values, form), 1)), match)


ENTITIES = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))


DOCTYPES = (
    f'<!DOCTYPE modelSet [<!ENTITY l0 "ha">{ENTITIES}]>',
    '<!DOCTYPE modelSet [<!ENTITY l9 SYSTEM "file:///etc/passwd">]>',
    '<!DOCTYPE modelSet SYSTEM "http://localhost:1/evil.dtd">',
    '<!DOCTYPE modelSet [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]>',
)


def test_entities_and_document_types_are_refused(write):
    text = document().replace("Slate", "&l9;")
    for doctype in DOCTYPES:
        assert_refused(write(text.replace("<modelSet", f"{doctype}<modelSet", 1)), "Remove the declaration")


def test_size_depth_and_number_of_elements_are_limited(write, monkeypatch):
    assert_refused(write("<modelSet>" + "<a>" * 50), "levels")
    monkeypatch.setattr(hatt_xml, "MAX_ELEMENTS", 1000)
    assert_refused(write("<modelSet>" + "<a/>" * 2000), "elements")
    monkeypatch.setattr(hatt_xml, "MAX_FILE_BYTES", 1000)
    assert_refused(write(document()), "at most 1000")


def test_other_encodings_and_suffixes_are_refused(slate, tmp_path):
    path = tmp_path / "a.xml"
    path.write_bytes(document().replace("utf-8", "iso-8859-1").replace("Slate", "Größe").encode("latin-1"))
    assert_refused(path, "well formed")
    with pytest.raises(ValueError, match=r"Expected \.xml"):
        write_hatt(slate, tmp_path / "slate.txt")


# Conversion of textures of other families -------------------------------------------------------------------


def test_models_at_the_recorded_speeds_are_unchanged_at_the_same_rate():
    converted = to_hatt(lpc(1000.0))
    assert converted.mesh.largest == (150.0, 1.0)
    k, taps = converted.at(150.0, 1.0)
    assert_allclose(k, SLATE[1], atol=1e-12)
    assert np.linalg.norm(taps) == pytest.approx(float(Autoregression(SLATE[1], np.array(0.5)).level))
    assert converted.name == "slate"


def test_another_rate_keeps_the_spectrum_below_500_hz():
    texture = lpc(4000.0)
    converted = to_hatt(texture, order=20)
    assert (converted.fs, converted.order) == (1000.0, 20)
    k, taps = converted.at(150.0, 1.0)
    gain = np.linalg.norm(taps) * np.prod(np.sqrt(1 - k**2))
    hz = np.linspace(20, 450, 100)
    old = texture.at(150.0).log_spectrum_db(2 * np.pi * hz / 4000) - 10 * np.log10(4000)
    new = Autoregression(k, gain).log_spectrum_db(2 * np.pi * hz / 1000) - 10 * np.log10(1000)
    assert_allclose(new, old, atol=0.5)


def test_models_of_a_higher_order_are_fitted_again():
    x = np.random.default_rng(0).standard_normal(4000)
    long = fit(np.stack([x[:2000], x[2000:]]), 200)
    converted = to_hatt(LpcTexture([50.0, 150.0], long, 3.0, 1000.0, "noise"), order=12)
    assert converted.order == 12
    assert np.linalg.norm(converted.at(50.0, 1.0)[1]) == pytest.approx(float(long.level[0]), rel=0.02)


def test_a_network_is_sampled_on_a_grid(tmp_path):
    converted = to_hatt(network())
    assert converted.mesh.largest == pytest.approx((160.0, 2.0))
    k, level = network().models([[160.0, 0.0]], [2.0])
    taps = converted.at(160.0, 2.0)[1]
    assert_allclose(converted.at(160.0, 2.0)[0], k[0], atol=1e-9)
    assert np.linalg.norm(taps) == pytest.approx(level[0])
    loaded = read_hatt(write_hatt(converted, tmp_path / "a.xml"))
    assert_array_equal(loaded.ar_lsf, converted.ar_lsf)


def test_known_units_are_converted_to_m_s2(slate):
    assert_allclose(to_hatt(slate, unit="g").levels, 9.80665 * slate.levels)
    assert_array_equal(to_hatt(slate).variance, slate.variance)
    texture = lpc(1000.0)
    assert_allclose(to_hatt(texture, unit="g").levels, 9.80665 * to_hatt(texture).levels, rtol=1e-9)


def test_textures_and_options_that_hatt_cannot_represent_are_refused():
    for options, match in (
        ({"unit": "V"}, "unit must be"),
        ({"fs": 2000.0}, "as in the texture"),
        ({"fs": -1.0}, "fs must be"),
        ({"speeds": [0.0, 50.0]}, "must be positive"),
        ({"forces": [np.nan]}, "must be positive"),
    ):
        with pytest.raises(ValueError, match=match):
            to_hatt(lpc(1000.0), **options)
    with pytest.raises(ValueError, match="AR models"):
        to_hatt(frequencies())


def test_orders_too_high_for_the_direct_form_are_refused(slate, tmp_path):
    rng = np.random.default_rng(0)
    n, p = slate.mesh.speed.size, 400
    gaps = rng.uniform(0.001, 2, (n, p + 1))
    lsf = np.cumsum(gaps, axis=1)[:, :-1] / gaps.sum(axis=1, keepdims=True) * np.pi
    with pytest.raises(ValueError, match="direct form"):
        write_hatt(replace(slate, ar_lsf=lsf), tmp_path / "a.xml")
    assert not list(tmp_path.iterdir())
