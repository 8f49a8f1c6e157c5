"""The page of results: its structure, what it says, and what it refuses."""

import json
import re
import sys
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from page_results import HOSTILE, benchmark, feature, invariance, peers, stability, tradeoff, write_all

from texclass.cli import main
from texclass.experiment.accuracy import Accuracy
from texclass.experiment.nested_choice import NestedChoice
from texclass.reporting.page import read_result, render_page, write_page
from texclass.reporting.page.scales import Scale, around

REPORTS = Path(__file__).parents[2] / "reports"
VOID = {"meta", "link", "br", "img", "hr", "input"}


class Outline(HTMLParser):
    """What a reader of the structure sees: elements with their attributes, nesting, and texts."""

    def __init__(self, page: str):
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], tuple[str, ...]]] = []
        self.texts: list[tuple[str, str]] = []
        self._open: list[str] = []
        self.feed(page)
        assert not self._open, f"never closed: {self._open}"

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), tuple(self._open)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), tuple(self._open)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag, f"</{tag}> closes another element"

    def handle_data(self, data):
        self.texts.append((self._open[-1] if self._open else "", data))

    def every(self, tag):
        return [attributes for name, attributes, _ in self.elements if name == tag]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    return render_page([read_result(path) for path in write_all(folder)])


@pytest.fixture(scope="module")
def outline(page):
    return Outline(page)


def text_of(document, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(json.dumps(document))
    return render_page([read_result(path)])


def test_ids_are_unique_and_every_reference_leads_to_one(outline):
    ids = [a["id"] for _, a, _ in outline.elements if "id" in a]
    assert len(ids) == len(set(ids))
    for _, a, _ in outline.elements:
        for key in ("aria-labelledby", "aria-describedby"):
            assert set((a.get(key) or "").split()) <= set(ids)
        if a.get("href", "").startswith("#"):
            assert a["href"][1:] in ids


def test_headings_descend_one_level_at_a_time(outline):
    levels = [int(tag[1]) for tag, *_ in outline.elements if tag in {"h1", "h2", "h3", "h4"}]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_the_page_has_a_language_landmarks_and_a_way_past_them(outline):
    assert outline.every("html") == [{"lang": "en"}]
    assert all(len(outline.every(tag)) == 1 for tag in ("main", "nav", "header", "footer"))
    assert outline.every("a")[0]["href"] == "#main"


def test_every_picture_has_a_text_alternative_and_every_figure_its_numbers(outline):
    for tag, a, _ in outline.elements:
        if tag in {"svg", "img"}:
            named = a.get("aria-labelledby") and a.get("aria-describedby")
            assert named or a.get("aria-hidden") == "true"
    n_figures = len(outline.every("figure"))
    assert n_figures >= 10
    assert len(outline.every("figcaption")) == n_figures
    folded = [1 for tag, _, above in outline.elements if tag == "table" and above[-2:] == ("details", "div")]
    assert len(folded) >= n_figures


def test_tables_have_captions_and_scopes(outline):
    assert len(outline.every("caption")) == len(outline.every("table"))
    assert all(a.get("scope") in {"col", "row", "colgroup"} for a in outline.every("th"))


def test_lines_of_a_table_are_equally_long(page):
    for table in re.findall(r"<tbody>(.*?)</tbody>", page, re.S):
        lines = [re.findall(r"<t[dh][^>]*>", line) for line in table.split("</tr>")[:-1]]
        spans = [[re.findall(r'colspan="(\d+)"', cell) or [1] for cell in line] for line in lines]
        assert len({sum(int(n) for n, *_ in line) for line in spans}) == 1


def test_hostile_names_are_text_and_nothing_else(page, outline):
    assert HOSTILE not in page
    assert len(outline.every("script")) == 1
    assert not outline.every("img")
    assert any(HOSTILE in text for _, text in outline.texts)
    assert not any("javascript" in (a.get("href") or "") for a in outline.every("a"))


def test_nothing_on_the_page_leads_to_a_request(page, outline):
    assert not any("src" in a or a.get("href", "").startswith("//") for _, a, _ in outline.elements)
    assert [a["href"] for a in outline.every("link")] == ["data:,"]
    assert "url(" not in page
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_the_key_message_is_the_best_accuracy_beside_the_published_one(tmp_path):
    page = text_of(benchmark().to_dict(), tmp_path)
    assert (
        '<strong>90.0</strong> <span class="unit">%</span> <span class="interval">[82.6, 94.5]</span>' in page
    )
    assert "by All with LDA (95 % interval). Protocol: leave one operator out, 2 folds." in page
    assert "+4.0 points [−3.4, +8.5] against the 86 % published" in page


def test_what_was_chosen_inside_the_training_parts_is_told(tmp_path):
    choice = NestedChoice(Accuracy(70, 100), (("All", "lda"), ("All", "lda")), "operator")
    page = text_of(benchmark(choice=choice).to_dict(), tmp_path)
    assert "chosen inside each training part" in page.lower()
    assert "where tests have no say: 70 % [60.4, 78.1]." in page
    assert "All, LDA (2 of 2 folds)" in page
    broken = benchmark(choice=choice).to_dict()
    broken["choice"]["chosen"] = [["All"]]
    with pytest.raises(ValueError, match=r"choice\.chosen\[0\] has 1 members"):
        text_of(broken, tmp_path)


def test_without_a_published_figure_of_the_best_row_the_best_published_row_is_compared(tmp_path):
    result = benchmark().to_dict()
    result["rows"][0]["paper"] = {}
    page = text_of(result, tmp_path)
    assert "−10.0 points" in page
    assert "published for Row" in page
    result["rows"][1]["paper"] = {}
    assert "No row of this table has a published figure." in text_of(result, tmp_path)


def test_a_benchmark_without_any_computed_row_says_so(tmp_path):
    result = benchmark(confusion=None, gains=None).to_dict()
    for row in result["rows"]:
        row |= {"accuracy": {}, "missing": "no taps"}
    page = text_of(result, tmp_path)
    assert "No row could be computed" in page
    assert "not computed: no taps" in page


def test_the_confusion_matrix_has_a_cell_for_each_pair_and_lists_each_confusion(tmp_path):
    page = text_of(benchmark(n_materials=69).to_dict(), tmp_path)
    matrix = page.split('<table class="matrix large"')[1].split("</table>")[0]
    assert matrix.count("<td") == 69 * 69
    assert matrix.count('<td class="d5">9</td>') == 69
    assert "69 of 690 recordings are taken for another material" in page
    assert len(page) < 250_000


def test_the_knee_the_peers_the_gain_and_the_ratio_are_named(tmp_path):
    assert "knee: 89.5 %, 2 ms" in text_of(tradeoff().to_dict(), tmp_path)
    assert "ours is ahead" in text_of(peers().to_dict(), tmp_path)
    assert "when crest joins the best row" in text_of(feature(), tmp_path)
    assert "The same median for related work: 0.5." in text_of(invariance(), tmp_path)


def test_the_heat_map_of_the_extremes_says_each_cell_in_words(tmp_path):
    page = text_of(stability().to_dict(), tmp_path)
    assert "<strong>0</strong>" in page
    assert "of 2 pairs of subject and input are wrong in texclass" in page
    assert "by the same rule: 1 of 2." in page
    (row,) = re.findall(r'<th scope="row">librosa: fit</th>(.*?)</tr>', page)
    assert '<td class="e3" title="librosa: fit, plain: 1 WRONG, 1 exact of 2">' in row
    assert '<span class="hidden">1 WRONG, 1 exact of 2</span>' in row
    assert "Tsfel: not installed." in page


def test_a_mark_that_does_not_exist_is_refused(tmp_path):
    document = stability().to_dict()
    document["tallies"][0]["marks"]["fine"] = 1
    with pytest.raises(ValueError, match=r"tallies\[0\]\.marks has 'fine'; the rule is one of"):
        text_of(document, tmp_path)


def test_the_same_results_give_the_same_page(page, tmp_path):
    assert render_page([read_result(path) for path in write_all(tmp_path)]) == page


@pytest.mark.parametrize(
    "path",
    [REPORTS / "studies" / "stability.json", *sorted((REPORTS / "tables").glob("*.json"))],
    ids=lambda path: path.stem,
)
def test_committed_benchmarks_become_pages(path):
    Outline(render_page([read_result(path)]))


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "no JSON"),
        ("{", "no JSON"),
        ("[]", r"holds no result \(list\)"),
        ("{}", r"holds no result \(nothing\)"),
        ('{"seed": 1, "results": []}', r"holds no result \(seed, results\)"),
        ('{"rows": [NaN]}', "NaN is no JSON number"),
        ('{"rows": [], "pipeline": {}, "protocol": "x"}', "kind benchmark, dataset is missing"),
        ('{"contestants": 3}', "kind peers, dataset is missing"),
    ],
)
def test_what_is_no_result_is_refused_with_file_and_rule(text, rule, tmp_path):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"broken\.json: .*{rule}"):
        read_result(path)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda d: d["rows"][0]["accuracy"]["lda"].update(mean=90), r"\.lda\.mean is 90; .* 0 to 1"),
        (lambda d: d["rows"][0].pop("name"), r"rows\[0\]\.name is missing"),
        (lambda d: d["confusion"]["counts"].pop(), "confusion.counts has sides of .* is 3"),
        (lambda d: d.update(seed="seven"), "seed is 'seven'; the rule is a whole number"),
        (lambda d: d.update(rows=[]), r"rows has 0 members; the rule is at least 1"),
        (lambda d: d["gains"]["groups"][0]["paired"].update(low=None), r"groups\[0\]\.paired\.low is None"),
    ],
)  # fmt: skip
def test_a_broken_result_is_refused_with_place_and_rule(change, rule, tmp_path):
    document = benchmark().to_dict()
    change(document)
    path = tmp_path / "broken.json"
    path.write_text(json.dumps(document))
    with pytest.raises(ValueError, match=rf"broken\.json: .*{rule}"):
        read_result(path)


def test_binary_files_and_pages_over_results_are_refused(tmp_path):
    path = tmp_path / "x.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"x\.json"):
        read_result(path)
    with pytest.raises(ValueError, match="a file of its own"):
        write_page([path], path)
    with pytest.raises(ValueError, match="0 results"):
        render_page([])


def test_the_command_writes_the_page_or_one_line_of_error(tmp_path, monkeypatch, capsys):
    paths = write_all(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        sys, "argv", ["texclass", "report", *map(str, paths), "-o", "out/r.html", "--title", "My <b>"]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert "<h1>My &lt;b&gt;</h1>" in Path("out/r.html").read_text(encoding="utf-8")
    (tmp_path / "other.json").write_text("{}")
    monkeypatch.setattr(sys, "argv", ["texclass", "report", "other.json"])
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    error = capsys.readouterr().err
    assert error.startswith("error: other.json: holds no result")
    assert error.count("\n") == 1


@pytest.mark.parametrize("ends", [(0.0, 1.0), (3.2, 178.0), (-0.5, 0.25), (40.0, 100.0)])
def test_ticks_are_round_and_inside(ends):
    ticks = Scale(*ends).ticks
    assert 3 <= len(ticks) <= 7
    assert all(ends[0] - 1e-9 <= tick <= ends[1] + 1e-9 for tick in ticks)


def test_a_logarithmic_axis_places_ratios_equally():
    scale = Scale(1.0, 100.0, log=True)
    assert scale(10.0) == pytest.approx(0.5)
    assert scale(0.0) == 0.0
    assert around([5.0, 5.0])(5.0) == pytest.approx(0.5)
