"""The HTML page of results: structure, content, rejected input."""

import json
import re
import sys
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from example_results import DATA, FILES, HOSTILE, result

from texclass.cli.result_files import read_document, write_page
from texclass.reporting.result_files import RESULTS, read_result

REPORTS = Path(__file__).parents[2] / "reports"
INVARIANCE = DATA / "invariance.json"
"""Of the page of one figure."""
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
def page(page_file):
    return page_file.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def outline(page):
    return Outline(page)


@pytest.fixture
def text_of(tmp_path, monkeypatch):
    """Return what gives the page of a result, its figures left blank."""
    monkeypatch.setattr("texclass.reporting.page.inline_svg", lambda *_: "<svg></svg>")

    def page_of(data):
        path = tmp_path / "result.json"
        path.write_text(json.dumps(data))
        return write_page([path], tmp_path / "page.html").read_text(encoding="utf-8")

    return page_of


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
            assert a.get("aria-labelledby")
            assert a.get("aria-describedby")
    n_figures = len(outline.every("figure"))
    assert n_figures >= 10
    assert len(outline.every("figcaption")) == n_figures
    folded = [
        1 for tag, _, above in outline.elements if tag == "table" and "details" in above and "figure" in above
    ]
    # What groups add stands in a table above its figure, and a heat map of the battery is a table itself.
    assert len(folded) >= n_figures - 6


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
    assert not any("src" in a or a.get("href", "#")[:1] not in "#dh" for _, a, _ in outline.elements)
    assert [a["href"] for a in outline.every("link")] == ["data:,"]
    assert not re.search(r"url\((?!#)", page)
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_the_finding_is_the_best_accuracy_with_the_published_one(text_of):
    page = text_of(result("benchmark"))
    assert (
        '<strong>90.0</strong> <span class="unit">%</span> <span class="interval">[82.6, 94.5]</span>' in page
    )
    assert "selected on the test folds (optimistic; 95 % confidence" in page
    assert "interval; chance level 33.3 %)." in page
    assert "+4.0 points [−3.4, +8.5] relative to the published 86 %" in page


def test_the_confusion_matrix_has_a_cell_for_each_pair_and_lists_each_confusion(text_of):
    data, n = result("benchmark"), 69
    names = [f"surface-{i:02d}" for i in range(n)]
    counts = [[9 * (i == j) + ((i + 1) % n == j) for j in range(n)] for i in range(n)]
    data["confusion"] |= {"surfaces": names, "counts": counts}
    page = text_of(data)
    matrix = page.split('<table class="matrix large"')[1].split("</table>")[0]
    assert matrix.count("<td") == n * n
    assert matrix.count('<td class="d5"') == n
    assert "69 of 690 recordings are misclassified" in page
    assert len(page) < 250_000


def test_each_cell_of_the_heat_map_of_extreme_inputs_has_a_description(text_of):
    page = text_of(result("stability"))
    rows = re.findall(r'<th scope="row">librosa: fit</th>(.*?)</tr>', page)
    assert '<td class="e3" title="librosa: fit, plain: 1 exact, 1 WRONG of 2">1</td>' in rows[0]


def test_the_same_results_give_the_same_page(tmp_path):
    one, other = (write_page([INVARIANCE], tmp_path / name).read_bytes() for name in ("a.html", "b.html"))
    assert one == other


def test_results_with_equal_titles_are_distinguished(tmp_path, monkeypatch):
    monkeypatch.setattr("texclass.reporting.page.inline_svg", lambda *_: "")
    for name in ("a", "b"):
        (tmp_path / f"{name}.json").write_text(
            json.dumps(result("benchmark") | {"pipeline": {"name": name, "hash": "ff", "features": "f"}})
        )
    page = write_page([tmp_path / "a.json", tmp_path / "b.json"], tmp_path / "x.html").read_text()
    assert "toy, leave one operator out: Pipeline a" in page
    assert page.count("<h3>toy</h3>") == 1


def test_committed_markdown_is_that_of_the_committed_results(tmp_path):
    folder = REPORTS / "tables"
    for markdown_file in sorted(folder.glob("*.md")):
        results = sorted(folder.glob(f"{markdown_file.stem}-*.json"))
        rewritten = write_page(results, tmp_path / markdown_file.name)
        assert rewritten.read_text(encoding="utf-8") == markdown_file.read_text(encoding="utf-8"), (
            markdown_file.name
        )


def test_committed_results_are_read_and_become_one_page(tmp_path):
    files = [REPORTS / "studies" / f"{name}.json" for name in ("stability", "invariance")]
    files += sorted((REPORTS / "tables").glob("*.json"))
    assert len(files) > 20
    assert all(read_document(file).finding for file in files)
    Outline(write_page(files[-1:], tmp_path / "all.html").read_text(encoding="utf-8"))


def test_every_kind_of_result_but_a_study_has_an_example_here():
    # A docstring that was run in the same process may have defined another kind.
    shipped = {kind for kind, cls in RESULTS.items() if hasattr(sys.modules[cls.__module__], cls.__name__)}
    assert {file.stem for file in FILES} == shipped - {"study"}
    for kind in shipped - {"study"}:
        matches = read_result(DATA / f"{kind}.json")
        assert type(matches) is RESULTS[kind]
        assert json.loads(matches.to_json()) == result(kind)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "not a valid JSON file"),
        ("{", "not a valid JSON file"),
        ("[" * 5000, "not a valid JSON file"),
        ("[]", "kind 'None', version 'None'.* benchmark .version 1."),
        ('{"rows": [], "pipeline": {}}', "kind 'None'"),
        ('{"kind": ["benchmark"], "version": 1}', r"kind \"\['benchmark'\]\""),
        ('{"kind": "bench", "version": 1}', "kind 'bench', version '1'.* benchmark .version 1."),
        ('{"kind": "benchmark", "version": 0}', "version '0'.* benchmark .version 1."),
        (
            '{"kind": "benchmark", "version": 1, "rows": [NaN]}',
            "numbers must be at most 1e100 in magnitude, got NaN",
        ),
        ('{"kind": "benchmark", "version": 1}', "the result is damaged .KeyError"),
        ('{"kind": "study", "version": 1}', "a study has no document"),
    ],
)
def test_files_without_a_result_are_rejected_with_file_and_value(text, fault, tmp_path):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"broken\.json: .*{fault}"):
        read_document(path)


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("benchmark", lambda d: d["rows"][0].pop("name")),
        ("benchmark", lambda d: d["rows"][0].update(accuracy=3)),
        ("benchmark", lambda d: d["example"]["low"].pop()),
        ("benchmark", lambda d: d["ablation"]["groups"][0]["comparison"].update(low=None)),
        ("benchmark", lambda d: d.update(nested_cv={"accuracy": {"mean": 1, "low": 1, "high": 1}})),
        ("benchmark", lambda d: d["rows"][0].update(ms_per_recording=1e308)),
        ("stability", lambda d: d.pop("tallies")),
        ("tradeoff", lambda d: d["curves"][0]["x"].pop()),
    ],
)  # fmt: skip
def test_a_damaged_result_is_rejected_with_its_file(kind, change, tmp_path):
    data, path = result(kind), tmp_path / "broken.json"
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=r"broken\.json: "):
        write_page([path], tmp_path / "page.html")


def test_binary_files_and_output_over_results_are_rejected(tmp_path):
    path = tmp_path / "x.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"x\.json"):
        read_document(path)
    with pytest.raises(ValueError, match="is one of the results"):
        write_page([path], path)
    with pytest.raises(ValueError, match="documents is empty"):
        write_page([], tmp_path / "page.html")


def test_the_command_writes_the_page_or_one_line_of_error(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = command("report", INVARIANCE, "-o", "out/r.html", "--title", "My <b>")
    assert code == 0, err
    assert "<h1>My &lt;b&gt;</h1>" in Path("out/r.html").read_text(encoding="utf-8")
    (tmp_path / "other.json").write_text("{}")
    code, _, err = command("report", "other.json")
    assert code == 1
    assert err.startswith("error: other.json: contains no result")
    assert err.count("\n") == 1
