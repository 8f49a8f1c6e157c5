"""The table beside the accuracies: what balance and vote say that the accuracy does not."""

import numpy as np
import pytest
from rich.console import Console

from texclass.experiment.accuracy import score
from texclass.experiment.result import BenchmarkResult, RowResult
from texclass.reporting.beside import beside_markdown, beside_title
from texclass.reporting.tables import benchmark_table, headline, markdown

TRUTH, GUESS = np.array(list("ffffffoo")), np.array(list("ffofffoo"))
RUNS = np.array([1, 1, 1, 2, 2, 2, 3, 3])


def a_result(accuracy, **facts):
    rows = (RowResult("Level", 1, {"lda": accuracy}), RowResult("Taps", 1, {}, missing="no tap found"))
    dataset = {"name": "toy", "n_recordings": 3, "n_materials": 2, "notes": [], **facts}
    return BenchmarkResult(
        dataset, "p", "ff", "f", ("lda",), "run", "by run", 1, rows, None, {}, 0, "abc", unit="run"
    )


@pytest.fixture
def windows():
    return a_result(score([TRUTH], [GUESS], [RUNS]), n_windows=8)


def rendered(result):
    console = Console(width=120)
    with console.capture() as capture:
        console.print(benchmark_table(result))
    return capture.get()


def test_windows_have_their_balance_and_the_vote_of_each_run(windows):
    assert beside_title(windows) == "Balanced accuracy / per run, by majority of its windows, in %"
    assert beside_markdown(windows)[-1] == "| Level | 91.7 / 100.0 [43.9, 100.0] |"


@pytest.mark.parametrize("text_of", [rendered, markdown])
@pytest.mark.parametrize(
    "text",
    ["8 windows of 3 recordings of 2 materials", "share of windows", "a bootstrap over runs", "91.7 / 100"],
)
def test_a_reader_is_told_what_was_counted(windows, text_of, text):
    assert text in " ".join(text_of(windows).split())


def test_recordings_of_unequal_materials_have_their_balance_only():
    result = a_result(score([TRUTH], [GUESS], [np.arange(8)]))
    assert beside_title(result) == "Balanced accuracy, in %"
    assert beside_markdown(result)[-1] == "| Level | 91.7 |"
    assert "windows" not in headline(result)


def test_equal_numbers_of_recordings_need_no_table_beside():
    labels = np.array(list("fofo"))
    result = a_result(score([labels], [labels], [np.arange(4)]))
    assert beside_title(result) is None
    assert "Balanced" not in markdown(result)
