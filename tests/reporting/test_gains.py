"""What a reader sees of the gains."""

import pytest
from rich.console import Console

from texclass.experiment.paired import Paired
from texclass.experiment.result import Gains, GroupGain, RowSum
from texclass.reporting.gains import HEADER, draw_gains, gain_markdown, gain_rows, gain_table, verdict


def paired(difference, p):
    return Paired(difference, (difference - 0.02, difference + 0.02), p, "t-test", ((difference, 0.0),), 3, 1)


HELPS = GroupGain("Spectra", 4, RowSum(7, 0.95, 2.5), paired(0.05, 0.001), 0.002)
IDLE = GroupGain("Luck", 1, RowSum(4, 0.91, 2.0), paired(0.01, 0.4), 0.4)
LACKS = GroupGain("Taps", 2, missing="no tap found (hardness)")


def gains(*groups, accuracy=0.9, **changes):
    fields = {
        "row": "All", "classifier": "lda", "chosen": "the best", "selects": True,
        "without": RowSum(3, accuracy, 1.5), "n_repeats": 5, "n_folds": 10, "groups": groups,
    }  # fmt: skip
    return Gains(**(fields | changes))


def rendered(found):
    console = Console(width=120, record=True)
    with console.capture() as capture:
        console.print(gain_table(found, 7))
    return capture.get()


def markdown(found):
    return "\n".join(gain_markdown(found, 7))


@pytest.mark.parametrize("text_of", [rendered, markdown])
@pytest.mark.parametrize(
    "text",
    ["What each group adds", "+5.0 [+3.0, +7.0]", "1/0", "0.002", "no tap found (hardness)", "seeds 7 to 11",
     "All, LDA (the best)", "t-test", "competes", "Significant (corrected p below 0.05): Spectra +5.0"],
)  # fmt: skip
def test_table_and_notes_say(text_of, text):
    assert text in text_of(gains(HELPS, IDLE, LACKS))


def test_every_row_has_a_cell_for_every_title():
    assert {len(row) for row in gain_rows(gains(HELPS, LACKS))} == {len(HEADER)}


def test_a_verdict_claims_no_more_than_was_found():
    assert verdict(gains(IDLE)) == "No significant difference with Luck (corrected p below 0.05)."
    assert "nothing to gain" in verdict(gains(IDLE, accuracy=1.0))
    assert verdict(gains(LACKS)) == "The dataset has none of the groups."


@pytest.mark.parametrize("groups", [(HELPS, IDLE, LACKS), (LACKS,)])
def test_the_picture_shows_every_measured_group(groups, tmp_path):
    figure = draw_gains(gains(*groups))
    figure.savefig(tmp_path / "gains.png")
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels == [f"+ {g.name} ({g.p_corrected:.3f})" for g in groups if g.paired]
