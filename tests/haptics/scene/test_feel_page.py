"""The page plays what the renderer plays, within a limit, and a hand in a browser is heard."""

import json
import shutil
import subprocess
import time

import numpy as np
import pytest
from chromium import needs_chromium
from typer.testing import CliRunner

from texclass.cli import app
from texclass.haptics.exchange import save_texture
from texclass.haptics.scene import PlannedScene, SceneRenderer, feel_page, write_feel_page
from texclass.haptics.scene import render_kernels as kernels
from texclass.haptics.scene.pages import files
from texclass.haptics.scene.renderer import packed
from texclass.haptics.textures import pack
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.recording import Phases, Recording, Tap
from texclass.vibration import TapModel

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="no node on the PATH")
V, F, N = np.array([40.0, 80.0, 160.0]), np.array([0.5, 2.0]), 3000
RNG = np.random.default_rng(0)
LATTICE = GridModel((V, F), RNG.uniform(-0.9, 0.9, (3, 2, 6)), RNG.uniform(1, 9, (3, 2)), 20.0)
LINES = GridModel(
    (V, F), np.full((3, 2, 2), 0.9), np.ones((3, 2)), 4.0, np.array([120.0, 0]), np.array([0, 2.0])
)
BOTH = GridModel((V, F), RNG.uniform(0, 0.8, (3, 2, 4)), np.ones((3, 2)), 4.0, np.array([90.0]), np.zeros(1))
LONG = GridModel((V[:1], F[:1]), RNG.uniform(-0.4, 0.4, (1, 1, 400)), np.ones((1, 1)), 4.0)
MODELS = {"lattice": LATTICE, "lines": LINES, "both": BOTH, "order 400": LONG, "nothing": GridModel.silence()}
TAP = TapModel(30.0, 90.0, 210.0)


def scene_of(models, fs=1000.0):
    assigned = {name: i for i, name in enumerate(models)}
    return PlannedScene("all", fs, "m/s^2", (20.0, 450.0), 30.0, 1, assigned, tuple(models.values()))


def drawn(n, seed=5):
    """Return the noise that the renderer of one contact draws first."""
    phase = np.zeros((1, len(kernels.Phase)), dtype=np.int64)
    phase[0, kernels.Phase.NOISE] = (
        np.random.SeedSequence(seed).generate_state(1, np.uint64).view(np.int64)[0]
    )
    return [kernels.draw(phase, 0) for _ in range(n)]


def script(scene):
    """A path over all surfaces with jumps, rests and lifts, the renderer's noise, and what it plays there."""
    rng, names = np.random.default_rng(1), [*scene.assigned, None]
    stay = np.repeat(np.arange(N // 60), 60)
    speed, force = 10.0 ** rng.uniform(0.5, 3, N // 60), rng.choice([-1.0, 0.1, 1.0, 5.0], N // 60)
    speed[::7] = 0.0
    which = rng.integers(0, len(names), N // 60)
    which[: len(names)] = range(len(names))
    vx, vy, pressed = 0.6 * speed[stay], -0.8 * speed[stay], force[stay]
    touched = [names[i] for i in which[stay]]
    renderer = SceneRenderer(scene, n_contacts=1, seed=5)
    played = renderer.process(np.stack([vx, vy], axis=-1)[np.newaxis], pressed[np.newaxis], [touched])[0]
    model = [scene.assigned.get(name, -1) for name in touched]
    bank, index = packed(scene)
    given = {"vx": vx.tolist(), "vy": vy.tolist(), "force": pressed.tolist(), "model": model}
    given["noise"] = drawn(40 * N)
    return {"bank": bank.tolist(), "index": index.ravel().tolist(), "script": given, "fs": scene.fs}, played


def node(program, given=None):
    """Run a program behind the kernels and the worklet; return what it says as JSON."""
    folder = files("texclass.haptics.scene").joinpath("feel")
    head = "".join(folder.joinpath(f"{name}.js").read_text() for name in ("kernels", "worklet"))
    read = "const given = JSON.parse(require('fs').readFileSync(0, 'utf8'));"
    text = f"{head}{read} console.log(JSON.stringify((() => {{ {program} }})()));"
    done = subprocess.run(
        [NODE, "-e", text], input=json.dumps(given), capture_output=True, text=True, check=False
    )
    assert not done.returncode, done.stderr
    return json.loads(done.stdout)


PLAY = """
let drawn = 0;
const { vx, vy, force, model, noise } = given.script;
const renderer = createRenderer(Float64Array.from(given.bank), given.index, 1, () => noise[drawn++]);
return vx.map((_, t) => { renderer.touch(0, model[t]); return renderer.step(0, vx[t], vy[t], force[t]); });"""


@needs_node
@pytest.mark.parametrize("fs", [1000.0, 3000.0])
@pytest.mark.parametrize("names", [*([name] for name in MODELS), list(MODELS)], ids=", ".join)
def test_the_same_noise_on_the_same_path_gives_the_samples_of_the_renderer(names, fs):
    given, played = script(scene_of({name: MODELS[name] for name in names}, fs))
    found = np.array(node(PLAY, given))
    assert np.abs(found - played).max() <= 1e-9 * np.abs(played).max()
    assert np.abs(played).max() > 0 or names == ["nothing"]


@needs_node
def test_a_tone_keeps_height_and_frequency_at_the_rate_of_the_loudspeaker_and_has_no_image():
    found = np.array(
        node("let t = 0; const next = createInterpolator(() => Math.sin(2 * Math.PI * 0.4 * t++), 1 / 48);"
             "return Array.from({ length: 48000 }, next);")
    )[4800:]  # fmt: skip
    spectrum = np.abs(np.fft.rfft(found * np.hanning(found.size))) / found.size * 4
    hz = np.fft.rfftfreq(found.size, 1 / 48000)
    assert hz[spectrum.argmax()] == pytest.approx(400, abs=1.2)
    assert spectrum.max() == pytest.approx(1, rel=0.01)
    assert spectrum[np.abs(hz - 400) > 10].max() < 1e-2


@needs_node
def test_a_tap_is_that_of_its_model():
    found = node("const taps = createTaps(48000); taps.strike([[30, 90, 210, 0]], 0.2);"
                 "return Array.from({ length: 5000 }, taps.next);")  # fmt: skip
    np.testing.assert_allclose(found, TAP.synthesize(0.2, 5000, 48000.0), atol=1e-9)


@needs_node
def test_nothing_that_leaves_the_limiter_is_above_half_of_full_scale_and_soft_sounds_are_untouched():
    found = node("const limit = createLimiter(48000); const loud = Array.from({ length: 9000 },"
                 "(_, t) => limit(100 * anyNoise() * (t % 2000 < 900))); const soft = createLimiter(48000);"
                 "return [Math.max(...loud.map(Math.abs)), soft(0.3), soft(-0.1)];")  # fmt: skip
    assert found == [pytest.approx(0.5), 0.3, -0.1]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    return write_feel_page(
        tmp_path_factory.mktemp("page") / "feel.html", scene_of(MODELS), taps={"lines": TAP}
    )


def text(browser, name):
    return browser.run(f"document.getElementById('{name}').textContent")


def comes(browser, name, words):
    """Wait until a text begins with some words, 3 s at most; return whether it does."""
    end = time.monotonic() + 3.0
    while not (found := text(browser, name).startswith(words)) and time.monotonic() < end:
        time.sleep(0.02)
    return found


def mouse(browser, kind, x, y):
    browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


@needs_chromium
def test_in_the_browser_the_worklet_plays_the_samples_of_the_renderer(browser, page):
    browser.open(page)
    given, played = script(scene_of({name: MODELS[name] for name in ("lattice", "lines", "both", "nothing")}))
    found = browser.run(f"""(async () => {{
      const given = {json.dumps(given)}, context = new OfflineAudioContext(1, 48000 * 3.1, 48000);
      const code = ["kernels", "worklet"].map((id) => document.getElementById(id).textContent).join("");
      await context.audioWorklet.addModule("data:text/javascript," + encodeURIComponent(code));
      const options = {{ ...given, bank: Float64Array.from(given.bank), contacts: 1, full: 1, gain: 1 }};
      const node = new AudioWorkletNode(context, "feel", {{ numberOfInputs: 0, numberOfOutputs: 2,
        outputChannelCount: [1, 1], processorOptions: options }});
      node.connect(context.destination);
      const felt = new Promise((done) => {{
        node.port.onmessage = (e) => e.data.felt && done(e.data.felt);
      }});
      await context.startRendering();
      return felt;
    }})()""")
    assert np.abs(np.array(found) - played).max() <= 1e-4 * np.abs(played).max()


@needs_chromium
def test_a_stroke_is_heard_a_lift_silences_and_nothing_outside_is_asked_for(browser, page):
    browser.events.clear()
    browser.open(page)
    left, top, width, height = browser.run(
        "(() => { const r = document.querySelector('.face').getBoundingClientRect();"
        "return [r.left, r.top, r.width, r.height]; })()"
    )
    mouse(browser, "mousePressed", left + 9, top + height / 2)
    for i in range(25):
        mouse(browser, "mouseMoved", left + 9 + i * (width - 20) / 50, top + height / 2)
        time.sleep(0.012)
    assert text(browser, "said").startswith("lattice: ")
    assert text(browser, "level") != "silent"
    mouse(browser, "mouseReleased", left + 9, top + height / 2)
    assert comes(browser, "level", "silent")
    assert not browser.noises(page)


@needs_chromium
def test_arrow_keys_stroke_at_the_chosen_speed_and_enter_taps(browser, page):
    browser.open(page)
    browser.run("document.querySelectorAll('.tile')[1].focus(); document.getElementById('speed').value = 100")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight", windowsVirtualKeyCode=39)
    assert comes(browser, "said", "lines: 100 mm/s")
    browser.call("Input.dispatchKeyEvent", type="keyUp", key="ArrowRight", windowsVirtualKeyCode=39)
    browser.press("Enter", 13)
    assert comes(browser, "said", "lines: tapped")


@needs_chromium
def test_the_page_never_scrolls_sideways(browser, page):
    for width in (360, 768, 1400):
        browser.open(page, width=width, scheme="dark")
        assert browser.run("document.documentElement.scrollWidth") <= width


def test_hostile_names_stay_text_and_a_rate_above_the_loudspeakers_is_refused():
    hostile = "</script><script>alert(1)</script>"
    found = feel_page(scene_of({hostile: LATTICE}))
    assert hostile not in found
    with pytest.raises(ValueError, match="at most 44100"):
        feel_page(scene_of({"a": LATTICE}, fs=96_000.0))


def test_the_page_of_a_packed_texture_taps_as_the_recording_did(tmp_path):
    rng, fs = np.random.default_rng(0), 2000.0
    knock = 40.0 * np.exp(-90 * np.arange(400) / fs) * np.sin(2 * np.pi * 210 * np.arange(400) / fs)
    x = np.concatenate([np.zeros(600), knock, np.zeros(200), rng.standard_normal(4000)])
    felt = Recording(x, fs, "m/s^2", "felt", phases=Phases((Tap(550, 600, 1000),), (1200, x.size)))
    file = save_texture(pack(felt, 64), tmp_path / "felt.texture")
    done = CliRunner().invoke(app, ["texture", str(file), "--page", str(tmp_path / "feel.html")])
    assert done.exit_code == 0, done.output
    page = (tmp_path / "feel.html").read_text()
    assert "Taps were measured." in page
    ((amplitude, decay, hz, _), *_), _ = json.JSONDecoder().raw_decode(page.split('"tap": ')[1])
    assert (amplitude, decay, hz) == pytest.approx((400, 90, 210), rel=0.2)


def test_the_commands_write_a_small_page_of_a_planned_scene_with_measured_taps(tmp_path):
    planned = scene_of(MODELS).save(tmp_path / "all.texture")
    taps = save_texture(TapLibrary(("lines",), (TAP,)), tmp_path / "taps.texture")
    for options in (["scene", "page", planned, "--taps", taps, "-o"], ["texture", planned, "--page"]):
        done = CliRunner().invoke(app, [*map(str, options), str(tmp_path / "feel.html")])
        assert done.exit_code == 0, done.output
        assert (tmp_path / "feel.html").stat().st_size < 300_000
        assert ("Taps were measured, but for 4" in (tmp_path / "feel.html").read_text()) == (
            "--taps" in options
        )
    done = CliRunner().invoke(app, ["scene", "page", str(planned), "-o", str(tmp_path / "feel.txt")])
    assert "Expected .html" in str(done.exception)
