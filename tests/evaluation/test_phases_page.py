"""The page on which users correct phases, in headless Chromium: what it saves is what every command uses."""

import base64
import io
import json
import time
from dataclasses import replace

import numpy as np
import pytest
from chromium import CONTRASTS, needs_chromium
from PIL import Image

from texclass.evaluation import phases_page as module
from texclass.evaluation.phases_page import phases_page
from texclass.loaders import load_recording, open_dataset
from texclass.loaders.phases_files import PhasesFile, phases_path
from texclass.phases import find_phases
from texclass.recording import Recording, RecordingError

FS = 10_000.0
READING = {"fs": FS, "unit": "m/s^2"}
OPTIONS = ("--fs", "10000", "--unit", "m/s^2")
ALT, CTRL, SHIFT = 1, 2, 8
LEFT, RIGHT = ("ArrowLeft", 37), ("ArrowRight", 39)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Give a folder with a recording of taps and movement, and its page."""
    folder = tmp_path_factory.mktemp("pages")
    recording = open_dataset("simulated")[0]
    samples = np.column_stack([recording.acceleration, recording.friction])
    np.savetxt(
        folder / "oak_1.csv", samples, delimiter=",", header="ax,ay,az,friction", comments="", fmt="%.6g"
    )
    (folder / "oak_1.html").write_text(phases_page(load(folder)), encoding="utf-8")
    return folder


@pytest.fixture
def page(browser, folder):
    """Show the page, with a picker of files that keeps what it saves."""
    show(browser, folder / "oak_1.html")
    yield browser
    assert not browser.noises(folder / "oak_1.html")


def load(folder):
    return load_recording(folder / "oak_1.csv", **READING, auxiliary={"friction": "friction"})


def show(browser, path, **options):
    # Without this, the browser would ask whether to leave the page, and wait for an answer.
    script = """window.addEventListener = (type, ...rest) => {
      if (type === "beforeunload") window.warn = rest[0];
      else EventTarget.prototype.addEventListener.call(window, type, ...rest);
    }"""
    identifier = browser.call("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
    browser.events.clear()
    browser.open(path, **options)
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=identifier)
    browser.call("Emulation.setFocusEmulationEnabled", enabled=True)
    browser.run("""window.showSaveFilePicker = async ({ suggestedName }) => ({
      name: suggestedName,
      createWritable: async () => ({ write: (text) => { window.saved = text; }, close: () => {} }),
    })""")


def save(browser):
    """Save the page with its key, and return the content of the file."""
    browser.run("window.saved = ''")
    browser.press("s", 83, CTRL)
    assert browser.run("new Promise((done) => setTimeout(() => done(window.saved), 50))"), status(browser)
    return json.loads(browser.run("window.saved"))


def status(browser):
    return browser.run("document.getElementById('status').textContent")


def box(browser, selector):
    """Return left, top, width and height of an element."""
    return browser.run(
        f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect();"
        "return [b.left, b.top, b.width, b.height]; })()"
    )


def mouse(browser, kind, x, y, **options):
    browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, **options)


def drag(browser, x0, y, x1, *, release=True):
    mouse(browser, "mousePressed", x0, y, clickCount=1)
    for share in (0.3, 0.7, 1.0):
        mouse(browser, "mouseMoved", x0 + share * (x1 - x0), y)
    if release:
        mouse(browser, "mouseReleased", x1, y, clickCount=1)


def focus(browser, selector):
    browser.run(f"document.querySelector('{selector}').focus()")


def samples(browser, selector):
    """Return the number of samples in a distance of one pixel."""
    return load_n(browser) / box(browser, selector)[2]


def load_n(browser):
    return browser.run("JSON.parse(document.getElementById('data').textContent).n_samples")


@needs_chromium
def test_the_page_opens_silently_with_the_detected_phases(browser, folder):
    show(browser, folder / "oak_1.html")
    assert not browser.noises(folder / "oak_1.html")
    phases = find_phases(load(folder))
    assert len(phases.taps) > 2
    labels = browser.run("[...document.querySelectorAll('.interval')].map((e) => e.ariaLabel)")
    assert labels == [*(f"Tap {k + 1}" for k in range(len(phases.taps))), "Movement 1"]
    assert browser.run("document.querySelectorAll('canvas').length") == 2  # acceleration and friction


@needs_chromium
def test_saved_without_changes_the_phases_stay_the_same(page, folder):
    recording = load(folder)
    content = PhasesFile.model_validate_json(json.dumps(save(page)))
    assert content.phases(recording) == replace(find_phases(recording), notes=())
    content.check(recording, folder / "oak_1.csv", folder / "saved")


@needs_chromium
def test_the_mouse_drags_edges_and_whole_intervals_and_undo_restores_them(page):
    first, per_pixel = save(page), samples(page, "canvas") / FS
    left, top, width, height = box(page, "#movement .interval")
    drag(page, left + 2, top + height / 2, left + 62)
    moved = save(page)
    step = moved["movement"][0]["start_s"] - first["movement"][0]["start_s"]
    assert step == pytest.approx(60 * per_pixel, abs=2 * per_pixel)
    assert moved["movement"][0]["end_s"] == first["movement"][0]["end_s"]
    assert moved["taps"] == first["taps"]
    left, top, width, height = box(page, "#taps .interval")
    drag(page, left + width / 3, top + height / 2, left + width / 3 + 8)
    tap, before = save(page)["taps"][0], first["taps"][0]
    shift = tap["start_s"] - before["start_s"]
    assert shift == pytest.approx(8 * per_pixel, abs=2 * per_pixel)
    assert tap["end_s"] - before["end_s"] == pytest.approx(shift)
    assert tap["impact_s"] - before["impact_s"] == pytest.approx(shift)
    assert (tap["quality"], tap["width_s"]) == (1, 0)
    for _ in range(2):
        page.press("z", 90, CTRL)
    assert save(page) == first
    for _ in range(2):
        page.press("y", 89, CTRL)
    assert save(page)["taps"][0] == tap
    assert save(page)["movement"] == moved["movement"]


@needs_chromium
def test_an_interval_stops_at_its_neighbours_and_escape_cancels_a_drag(page):
    first = save(page)
    left, top, width, height = box(page, "#taps .interval")
    drag(page, left + width / 3, top + height / 2, left + 900)
    taps = save(page)["taps"]
    assert taps[0]["end_s"] == taps[1]["start_s"] == first["taps"][1]["start_s"]
    left, top, width, height = box(page, "#movement .interval")
    drag(page, left + 2, top + height / 2, left + 80, release=False)
    page.press("Escape", 27)
    mouse(page, "mouseReleased", left + 80, top + height / 2, clickCount=1)
    assert save(page)["movement"] == first["movement"]


@needs_chromium
def test_the_edges_of_the_selected_interval_are_dragged_on_the_signal_too(page):
    first, per_pixel = save(page), samples(page, "canvas") / FS
    focus(page, "#movement .interval")
    left, top, _, _ = box(page, "canvas")
    x = left + first["movement"][0]["start_s"] / per_pixel
    drag(page, x + 3, top + 100, x + 43)
    step = save(page)["movement"][0]["start_s"] - first["movement"][0]["start_s"]
    assert step == pytest.approx(40 * per_pixel, abs=2 * per_pixel)


@needs_chromium
def test_keys_select_move_resize_add_and_delete(page):
    first = save(page)
    focus(page, "canvas")
    page.press("Tab", 9)
    assert page.run("document.activeElement.ariaLabel") == "Tap 1"
    page.press("Tab", 9)
    assert page.run("document.activeElement.ariaLabel") == "Tap 2"
    page.press(*LEFT)
    page.press(*RIGHT, SHIFT)  # ten steps
    tap, before = save(page)["taps"][1], first["taps"][1]
    step = 0.02  # 1/500 of the recording, rounded up to 1, 2 or 5 times a power of ten
    assert tap["start_s"] - before["start_s"] == pytest.approx(9 * step)
    assert tap["end_s"] - before["end_s"] == pytest.approx(9 * step)
    page.press(*RIGHT, ALT)
    assert save(page)["taps"][1]["end_s"] - tap["end_s"] == pytest.approx(step)
    page.press("Enter", 13)  # arrow keys move the start
    assert "move the start" in page.run("document.activeElement.ariaValueText")
    page.press(*LEFT)
    assert save(page)["taps"][1]["start_s"] - tap["start_s"] == pytest.approx(-step)
    assert save(page)["taps"][1]["impact_s"] == tap["impact_s"]
    page.press("Delete", 46)
    assert len(save(page)["taps"]) == len(first["taps"]) - 1
    assert page.run("document.activeElement.ariaLabel") == "Tap 2"  # the focus is not lost
    page.press("z", 90, CTRL)
    assert len(save(page)["taps"]) == len(first["taps"])
    focus(page, "canvas")
    for _ in range(3):
        page.press(*LEFT, SHIFT)  # the cursor
    cursor = page.run("Number(document.activeElement.ariaValueNow)")
    page.press("t", 84)
    taps = save(page)["taps"]
    assert len(taps) == len(first["taps"]) + 1
    assert cursor == pytest.approx(load_n(page) / 2 / FS - 3 * 10 * step)
    assert any(tap["impact_s"] == pytest.approx(cursor) for tap in taps)
    assert status(page).startswith("Saved oak_1.phases.json")


@needs_chromium
def test_fields_set_times_and_names(page):
    focus(page, "#movement .interval")
    page.run("""(() => { const field = document.getElementById("start"); field.value = "3.25";
      field.dispatchEvent(new Event("change")); })()""")
    assert save(page)["movement"][0]["start_s"] == 3.25
    page.run("""(() => { const field = document.getElementById("start"); field.value = "-7";
      field.dispatchEvent(new Event("change")); })()""")
    assert save(page)["movement"][0]["start_s"] == 0
    page.press("s", 83)
    assert page.run("document.activeElement.id") == "surface"
    page.press("s", 83, CTRL)
    assert status(page) == "Not saved. Surface 1 has no name."
    page.call("Input.insertText", text="cork oak")
    assert save(page)["surfaces"][0]["surface"] == "cork oak"
    options = page.run("[...document.querySelectorAll('#known-surfaces option')].map((o) => o.value)")
    assert options == ["cork oak"]


@needs_chromium
def test_several_movements_need_surfaces(page):
    focus(page, "#movement .interval")
    page.run("""(() => { const field = document.getElementById("start"); field.value = "4.5";
      field.dispatchEvent(new Event("change")); })()""")
    focus(page, "canvas")
    page.press("m", 77)
    page.press("s", 83, CTRL)
    assert status(page).startswith("Not saved. There are 2 intervals of movement, but no surfaces.")
    assert page.run("document.querySelectorAll('#problems li').length") == 1


@needs_chromium
def test_the_wheel_and_the_buttons_zoom_and_the_signal_is_drawn_in_every_zoom(page):
    def interval_width():
        return box(page, "#taps .interval")[2]

    def darkness():
        page.run("new Promise((done) => setTimeout(done, 60))")
        left, top, width, height = box(page, "canvas")
        clip = {"x": left, "y": top, "width": width, "height": height, "scale": 1}
        image = page.call("Page.captureScreenshot", format="png", clip=clip)["data"]
        return (np.asarray(Image.open(io.BytesIO(base64.b64decode(image))).convert("L")) < 60).mean()

    left = box(page, "#taps .interval")[0]
    assert darkness() > 0.01
    first = interval_width()
    canvas_top = box(page, "canvas")[1]
    page.call("Input.dispatchMouseEvent", type="mouseWheel", x=left, y=canvas_top + 50, deltaX=0, deltaY=-200)
    page.run("new Promise((done) => setTimeout(done, 60))")
    assert interval_width() == pytest.approx(2 * first, rel=0.05)
    assert box(page, "#taps .interval")[0] == pytest.approx(left, abs=3)  # the point under the pointer stays
    for _ in range(14):
        page.run("document.getElementById('zoom-in').click()")
        assert darkness() > 0.0005
    page.run("document.getElementById('zoom-all').click()")
    assert interval_width() == pytest.approx(first)


@needs_chromium
def test_without_a_picker_the_file_is_downloaded_and_the_page_tells_where_to_put_it(page, folder, tmp_path):
    page.call("Browser.setDownloadBehavior", of_page=False, behavior="allow", downloadPath=str(tmp_path))
    page.run("delete window.showSaveFilePicker; window.showSaveFilePicker = undefined")
    focus(page, "#movement .interval")
    page.press("Delete", 46)
    page.run("document.getElementById('save').click()")
    file, end = tmp_path / "oak_1.phases.json", time.monotonic() + 5
    while not file.is_file() and time.monotonic() < end:
        time.sleep(0.02)
    assert PhasesFile.read(file).movement == ()
    assert f"Move it to {folder / 'oak_1.phases.json'}, or run: texclass inspect" in status(page)
    assert "--phases ~/Downloads/oak_1.phases.json" in status(page)


@needs_chromium
def test_unsaved_changes_warn_before_the_page_is_left(browser, folder):
    show(browser, folder / "oak_1.html")
    focus(browser, "#movement .interval")
    browser.press(*LEFT)
    assert browser.run("document.title").startswith("* ")
    browser.run("delete window.addEventListener; addEventListener('beforeunload', window.warn)")
    browser.run("setTimeout(() => location.reload(), 0)")
    end = time.monotonic() + 5
    dialogs = []
    while not dialogs and time.monotonic() < end:
        browser.call("Target.getTargets", of_page=False)  # the dialog stops the page
        dialogs = [e for e in browser.events if e.get("method") == "Page.javascriptDialogOpening"]
    assert dialogs[0]["params"]["type"] == "beforeunload"
    browser.call("Page.handleJavaScriptDialog", accept=False)
    save(browser)
    assert not browser.run("document.title").startswith("* ")


@needs_chromium
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_is_readable_and_nothing_scrolls_sideways(browser, folder, scheme):
    for width in (360, 768, 1400):
        show(browser, folder / "oak_1.html", width=width, scheme=scheme)
        assert browser.run("document.documentElement.scrollWidth") <= width
    focus(browser, "#taps .interval")
    browser.press("s", 83)
    browser.run("document.activeElement.blur()")
    contrasts = [pair for pair in browser.run(CONTRASTS) if "datalist" not in pair[1]]
    assert len(contrasts) > 20
    assert contrasts[0][0] >= 4.5, contrasts[:3]


@needs_chromium
def test_the_keys_are_listed(page):
    page.press("?", 191, SHIFT)
    assert page.run("document.getElementById('keys').open")
    assert page.run("document.querySelectorAll('#keys tr').length") == len(module.KEYS)
    page.press("t", 84)  # no key acts behind the list
    assert "Tap" not in status(page)


@needs_chromium
def test_commands_use_the_saved_phases(browser, folder, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("oak_1.npy", load(folder).acceleration)
    arguments = ("inspect", "oak_1.npy", *OPTIONS)
    assert command(*arguments, "--edit", "-o", "page.html") == (
        0, "wrote page.html. Open it in a browser, correct the phases, and save them\n", ""
    )  # fmt: skip
    detected = command(*arguments)[1]
    show(browser, tmp_path / "page.html")
    focus(browser, "#movement .interval")
    browser.run("""(() => { const field = document.getElementById("start"); field.value = "3.25";
      field.dispatchEvent(new Event("change")); })()""")
    content = save(browser)
    data = json.loads(browser.run("document.getElementById('data').textContent"))
    assert data["command"] == "texclass inspect oak_1.npy --fs 10000 --unit 'm/s^2' --phases"
    (tmp_path / "downloads").mkdir()
    (tmp_path / "downloads/oak_1.phases (1).json").write_text(json.dumps(content), encoding="utf-8")
    code, out, err = command(*arguments, "--phases", "downloads/oak_1.phases (1).json")
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == "wrote oak_1.phases.json"
    assert "movement 3.25 to" in out
    assert "movement 3.25 to" not in detected
    assert "note: phases from oak_1.phases.json, not detected" in out
    assert command(*arguments, "--edit", "-o", "page.html")[0] == 0
    assert json.loads(PhasesFile.read(phases_path(tmp_path / "oak_1.npy")).to_json()) == content
    show(browser, tmp_path / "page.html")
    assert save(browser) == content


def test_a_page_of_a_long_recording_is_small(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_VALUES", 1000)
    x = np.random.default_rng(0).standard_normal(25_001)
    x[12_345] = 100.0
    np.save(tmp_path / "long.npy", x)
    recording = load_recording(tmp_path / "long.npy", **READING)
    trace = module._trace("acceleration", recording)
    values = np.frombuffer(base64.b64decode(trace["values"]), "<i2") * trace["scale"] + trace["offset"]
    low, high = np.split(values, 2)
    assert len(low) == -(-len(x) // trace["block"]) <= 500
    assert np.argmax(high) == 12_345 // trace["block"]
    centred = x - x.mean()
    assert high.max() == pytest.approx(centred.max(), abs=0.01)
    assert low[0] == pytest.approx(centred[: int(trace["block"])].min(), abs=0.01)
    assert len(phases_page(recording)) < 100_000


def test_signals_of_another_rate_are_drawn_at_their_times():
    rng = np.random.default_rng(0)
    recording = Recording(
        rng.standard_normal(5000),
        FS,
        "m/s^2",
        friction=rng.standard_normal(50),
        auxiliary_fs={"friction": 100.0},
    )
    trace = module._trace("friction", recording)
    assert trace["block"] == 100
    assert len(base64.b64decode(trace["values"])) == 2 * 50
    assert module._trace("acceleration", recording)["block"] == 1


def test_names_are_escaped_and_recordings_without_file_are_refused(tmp_path):
    np.save(tmp_path / "<b>.npy", np.random.default_rng(0).standard_normal(5000))
    html = phases_page(load_recording(tmp_path / "<b>.npy", **READING))
    assert "<b>" not in html
    with pytest.raises(RecordingError, match="has no file of its own"):
        phases_page(open_dataset("simulated")[0])


def test_two_recordings_of_one_name_cannot_both_be_edited(tmp_path):
    samples = np.random.default_rng(0).standard_normal(5000)
    np.save(tmp_path / "oak.npy", samples)
    np.savetxt(tmp_path / "oak.txt", samples)
    recording = load_recording(tmp_path / "oak.npy", **READING)
    content = PhasesFile.from_phases(find_phases(recording), recording, tmp_path / "oak.npy")
    phases_path(tmp_path / "oak.npy").write_text(content.to_json(), encoding="utf-8")
    with pytest.raises(
        RecordingError, match=r"contains the phases of oak.npy, but oak.txt has the same name"
    ):
        phases_page(load_recording(tmp_path / "oak.txt", **READING))


def test_edit_requires_a_page_and_a_page_requires_edit(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("oak.npy", np.random.default_rng(0).standard_normal(5000))
    for arguments, message in (
        (("--edit",), "--edit requires --output"),
        (("--edit", "-o", "page.png"), "Expected .html with --edit"),
        (("-o", "page.html"), "Pass --edit to write a page"),
    ):
        code, _, err = command("inspect", "oak.npy", *OPTIONS, *arguments)
        assert (code, message in " ".join(err.replace("│", " ").split())) == (2, True), err


def test_phases_of_another_recording_are_not_copied(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(2):
        np.save(f"oak_{k}.npy", np.random.default_rng(k).standard_normal(5000))
    recording = load_recording("oak_0.npy", **READING)
    content = PhasesFile.from_phases(find_phases(recording), recording, tmp_path / "oak_0.npy")
    (tmp_path / "saved.json").write_text(content.to_json(), encoding="utf-8")
    code, out, err = command("inspect", "oak_1.npy", *OPTIONS, "--phases", "saved.json")
    assert (code, out) == (1, "")
    assert "the content of oak_1.npy differs" in err
    assert not (tmp_path / "oak_1.phases.json").exists()
