"""The HTML page in headless Chromium: no requests, readable in both schemes, usable by keyboard."""

import pytest
from chromium import CONTRASTS, needs_chromium

pytestmark = needs_chromium

FOCUSED = """(() => {
  const e = document.activeElement, all = [...document.querySelectorAll("*")];
  const mark = e.querySelector?.("use, path");
  const ringed = mark && getComputedStyle(mark).strokeWidth === "4px";
  const seen = getComputedStyle(e).outlineStyle !== "none" || ringed;
  return [all.indexOf(e), e.localName, e.className.baseVal ?? e.className, Boolean(seen)];
})()"""


@pytest.fixture(scope="module")
def path(page_file):
    return page_file


def test_the_page_is_silent_and_asks_for_nothing_outside(browser, path):
    browser.events.clear()
    browser.open(path)
    browser.run("new Promise((done) => setTimeout(done, 200))")
    assert browser.run("document.querySelectorAll('.point').length") > 20
    assert not browser.noises(path)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_what_is_behind_it(browser, path, scheme):
    browser.open(path, scheme=scheme)
    matches = browser.run(CONTRASTS)
    assert len(matches) > 500
    assert matches[0][0] >= 4.5, matches[:3]
    ground = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")


def test_the_tab_key_goes_down_the_page_and_what_has_the_focus_is_seen(browser, path):
    browser.open(path)
    stops = []
    for _ in range(200):
        browser.press("Tab", 9)
        stop = browser.run(FOCUSED)
        if stops and stop[0] <= stops[-1][0]:
            break
        stops.append(stop)
    assert [place for place, *_ in stops] == sorted(place for place, *_ in stops)
    assert all(seen for *_, seen in stops), [stop for stop in stops if not stop[-1]]
    assert stops[0][2] == "skip"
    kinds = [name for _, name, *_ in stops]
    assert kinds.count("g") == browser.run("document.querySelectorAll('svg.plot.wide:has(.point)').length")
    assert kinds.count("td") == browser.run("document.querySelectorAll('table.matrix').length")
    assert kinds.count("summary") == browser.run("document.querySelectorAll('summary').length")


def test_arrow_keys_move_through_the_matrix_and_say_what_is_there(browser, path):
    browser.open(path)
    browser.run("document.querySelector('table.matrix td').focus()")
    browser.press("ArrowRight", 39)
    label = "document.activeElement.getAttribute('aria-label')"
    label_text = "document.activeElement.closest('figure').querySelector('.readout').textContent"
    first = browser.run(label)
    assert first.endswith("predicted as surface-01: 1 of 10 recordings (10 %)")
    assert browser.run(label_text) == first
    browser.press("ArrowDown", 40)
    assert browser.run(label) == "surface-01 predicted as surface-01: 9 of 10 recordings (90 %)"
    browser.press("End", 35)
    browser.press("ArrowRight", 39)
    assert browser.run("document.activeElement.cellIndex") == 3


def test_arrow_keys_move_through_the_points_of_a_figure(browser, path):
    browser.open(path)
    browser.run("document.querySelector('svg.plot.wide .point').focus()")
    label = "document.activeElement.getAttribute('aria-label')"
    first = browser.run(label)
    browser.press("ArrowRight", 39)
    assert browser.run(label) != first
    browser.press("Home", 36)
    assert browser.run(label) == first


@pytest.mark.parametrize("width", [360, 768, 1400])
def test_the_page_never_scrolls_sideways(browser, path, width):
    browser.open(path, width=width)
    assert browser.run("document.documentElement.scrollWidth") <= width


def test_on_a_phone_a_row_begins_with_its_name_and_accuracy_and_captions_are_not_cut(browser, path):
    browser.open(path, width=360)
    table = "document.querySelector('#s2 table.sorts:not(figure *)')"
    right = f"{table}.tBodies[0].rows[0].cells[1].getBoundingClientRect().right"
    assert browser.run(f"{table}.tBodies[0].rows[0].cells[1].textContent").startswith("90.0")
    assert browser.run(right) <= 360
    assert browser.run(f"{table}.caption.getBoundingClientRect().right") <= 360


def test_a_heading_sorts_its_column_by_click_and_by_key(browser, path):
    browser.open(path)
    rows = """[...document.querySelector("#s2 table.sorts:not(figure *)").tBodies[0].rows]
      .map((row) => row.cells[0].textContent)"""
    as_written = browser.run(rows)
    button = "document.querySelectorAll('#s2 table.sorts:not(figure *) [data-column=\"1\"] button')[0]"
    state = f"{button}.closest('th').getAttribute('aria-sort')"
    browser.run(f"{button}.click()")
    assert browser.run(state) == "descending"
    assert browser.run(rows)[0] == "All"
    assert browser.run(rows)[-1] == "Friction"
    browser.run(f"{button}.focus()")
    browser.press("Enter", 13)
    assert browser.run(state) == "ascending"
    assert browser.run(rows) == [as_written[1], as_written[0], "Friction"]
    browser.press("Enter", 13)
    assert browser.run(state) is None
    assert browser.run(rows) == as_written
