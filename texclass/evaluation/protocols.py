"""Evaluation protocols: one class for each way to hold recordings out, and the registry of their names.

Command line, pipelines, reports, documentation and tests take names and titles from here. How rows are split
is in `texclass.evaluation.splits`, which is imported when a table is split: a command that lists the
protocols loads neither pandas nor scikit-learn.
"""

import re
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Literal

from texclass.reporting.wording import counted

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

    from texclass.evaluation.splits import Splits

LABELS = ("surface", "operator", "session", "repetition")
"""Columns of a table that a protocol by labels can name."""
Terms = list[tuple[str, list[str]]]
"""Label and values, all of which hold: the parsed form of "repetition=1-20,25 & session=a"."""


def _checked_label(label: str) -> str:
    if label not in LABELS:
        raise ValueError(f"no label of recordings is {label!r}. Expected one of {', '.join(LABELS)}")
    return label


def _terms(text: str) -> Terms:
    """Parse "repetition=1-20,25 & session=a"."""
    terms = [term.partition("=") for term in text.split("&")]
    for label, equals, values in terms:
        if not (equals and values.strip()):
            raise ValueError(
                f"recordings are chosen by {label.strip()!r}. Expected LABEL=VALUE,VALUE or LABEL=1-20"
            )
    return [
        (_checked_label(label.strip()), [v.strip() for v in values.split(",")]) for label, _, values in terms
    ]


class Protocol(ABC):
    """A way to hold recordings out.

    Attributes
    ----------
    name : str
        As given on the command line and in pipelines, and saved in results.
    title : str
        A few words for the title of a report.
    description : str
        One line for the report.
    choice : str
        How people write it, where that is more than one name.
    needs : tuple of str
        Labels of which one must be named for every recording.
    unit : {"recording", "run"}
        What is never separated, and votes when it holds several rows.
    is_random : bool
        Whether the seed draws the folds, so that another seed gives others.
    is_nested : bool
        Whether scaling and selection are fitted inside each fold. Only `paper` is not.
    """

    name: str
    title: str
    description: str
    choice: ClassVar[str] = ""
    needs: tuple[str, ...] = ()
    unit: Literal["recording", "run"] = "recording"
    is_random: bool = False
    is_nested: bool = True

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.name}>"

    def split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        """Return (train, test) row numbers for each fold.

        Parameters
        ----------
        table : DataFrame
            Labels of recordings, or of windows of them, one a row.
        n_folds : int
            Number of folds, where folds are drawn.
        seed : int
            Of the folds, where they are drawn.

        Raises
        ------
        ValueError
            If the table cannot be split in this way.
        """
        from texclass.evaluation.splits import split_tested

        return split_tested(lambda tested: self._split(tested, n_folds, seed), table)

    @abstractmethod
    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        """Return (train, test) of a table whose rows may all be tested."""

    def clusters(self, table: "pd.DataFrame") -> "NDArray[np.str_]":
        """Return which `unit` each row belongs to."""
        from texclass.evaluation.splits import runs
        from texclass.evaluation.windows import parents

        return (runs if self.unit == "run" else parents)(table).to_numpy(dtype=str)

    def independent(self, table: "pd.DataFrame") -> "tuple[str, NDArray[np.str_]]":
        """Return what an interval or a test is taken over, and which of them each row belongs to."""
        return self.unit, self.clusters(table)


class Stratified(Protocol):
    """Draw stratified folds over recordings."""

    name = "recording"
    title = "folds over recordings"
    description = "stratified folds over recordings; scaling and selection fitted inside each fold"
    is_random = True

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import stratified

        return stratified(table, n_folds, seed)


class Paper(Stratified):
    """Draw stratified folds as the paper did, after features were selected on all recordings."""

    name = "paper"
    title = "the paper's protocol"
    description = (
        "stratified folds as in `recording`, but scaling and selection are fitted once on ALL "
        "recordings, test folds included: optimistic, for comparison with the paper only"
    )
    is_nested = False


class Grouped(Protocol):
    """Draw folds over runs (sessions; recordings, where none are named)."""

    name = "grouped"
    title = "folds over whole runs"
    description = (
        "stratified folds over runs (sessions; recordings, where none are named): no run both trains and "
        "tests; scaling and selection fitted inside each fold"
    )
    unit = "run"
    is_random = True

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import grouped

        return grouped(table, n_folds, seed)


class LeaveOneOut(Protocol):
    """Test on each group of a label in turn; the groups are independent."""

    choice = "leave-out LABEL"

    def __init__(self, label: str) -> None:
        self.needs = (_checked_label(label),)
        self.name = f"leave-out {label}"
        self.title = f"leave one {label} out"
        self.description = f"{self.title}; scaling and selection fitted inside each fold"

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import leave_one_out, left_out_label

        return leave_one_out(table, left_out_label(table, self.needs))

    def independent(self, table: "pd.DataFrame") -> "tuple[str, NDArray[np.str_]]":
        """Return the label that is left out, and the group of each row."""
        from texclass.evaluation.splits import left_out_label

        label = left_out_label(table, self.needs)
        return label, table[label].to_numpy(dtype=str)


class Operator(LeaveOneOut):
    """Test on each operator in turn; on each session where operators are not named."""

    choice = ""

    def __init__(self) -> None:
        super().__init__("operator")
        self.name, self.needs = "operator", ("operator", "session")
        self.description = (
            "leave one operator (or session) out; scaling and selection fitted inside each fold"
        )


class Chronological(Protocol):
    """Train on the first half of the repetitions, test on the second."""

    name = "chronological"
    title = "first half of the repetitions to second half"
    description = "first half of each surface's repetitions trains, second half tests"
    needs = ("repetition",)

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import chronological

        return chronological(table)


class FewShot(Protocol):
    """Train on a few repetitions of each surface, from several starts.

    Parameters
    ----------
    n_shots : int
        Repetitions of each surface that train (default 3).
    """

    choice = "few-shot NUMBER"
    n_starts: ClassVar[int] = 4
    """Starts at most: the quarters of the first half of the repetitions."""

    def __init__(self, n_shots: int = 3) -> None:
        self.n_shots = n_shots
        self.name = "few-shot" if n_shots == 3 else f"few-shot {n_shots}"
        self.title = f"{counted(n_shots, 'repetition')}, several starts, to second half"
        self.description = (
            f"{counted(n_shots, 'repetition')} of each surface in a row train, from several starts in the "
            "first half on; third and fourth quarter of its repetitions test (without numbers: runs that are "
            "drawn train, the others test)"
        )

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import few_shot

        return few_shot(table, self.n_shots, self.n_starts, seed)


class ByLabels(Protocol):
    """Train on the recordings that some labels choose, test on those that others do."""

    choice = "LABEL=VALUES -> LABEL=VALUES"

    def __init__(self, train: str, test: str) -> None:
        self.train, self.test = _terms(train), _terms(test)
        self.name = self.title = f"{train} -> {test}"
        self.description = f"trains on {train}, tests on {test}"

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import by_labels

        return by_labels(table, self.train, self.test)


PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (Stratified(), Operator(), Chronological(), FewShot(), Grouped(), Paper())
}
"""The protocols with a name of their own, in the order of lists."""


def find_protocol(name: str) -> Protocol:
    """Return the protocol of that name: one of `PROTOCOLS`, `few-shot` of so many, or by any label.

    "few-shot 1" trains on single repetitions. "leave-out session" tests on each session in turn.
    "repetition=1-20 -> repetition=31-40" trains on these and tests on those; "operator=2,5 & session=a" are
    the recordings of operators 2 and 5 in session a.

    Raises
    ------
    ValueError
        If there is none; the message lists the known names.
    """
    if name in PROTOCOLS:
        return PROTOCOLS[name]
    if match := re.fullmatch("few-shot ([1-9][0-9]{0,5})", name):
        return FewShot(int(match[1]))
    if name.startswith("leave-out "):
        return LeaveOneOut(name.removeprefix("leave-out "))
    train, arrow, test = name.partition(" -> ")
    if arrow:
        return ByLabels(train, test)
    choices = (kind.choice for kind in (FewShot, LeaveOneOut, ByLabels))
    raise ValueError(f"no protocol is named {name!r}. Expected one of {', '.join((*PROTOCOLS, *choices))}")


def repeated(
    protocol: Protocol, table: "pd.DataFrame", n_folds: int, n_repeats: int, seed: int
) -> "tuple[Splits, ...]":
    """Return the splits of repeated cross-validation: those of seed, seed + 1, ....

    Raises
    ------
    ValueError
        If there is no repeat, or several of a protocol that splits in one way only.
    """
    if n_repeats < 1 or (n_repeats > 1 and not protocol.is_random):
        random = ", ".join(p.name for p in PROTOCOLS.values() if p.is_random)
        raise ValueError(
            f"{n_repeats} repeats of the protocol `{protocol.name}`. "
            f"Expected 1, or more of a protocol that draws its folds ({random})"
        )
    return tuple(protocol.split(table, n_folds, seed + r) for r in range(n_repeats))


def splits_of(protocol: Protocol, table: "pd.DataFrame", seed: int) -> "Splits":
    """Return how a protocol holds the rows of a table out, in at most five folds where it draws them.

    Raises
    ------
    ValueError
        If it cannot, or lets test recordings be seen.
    """
    require_unseen(protocol)
    return protocol.split(table, max(2, min(5, fewest(protocol, table))), seed)


def require_unseen(protocol: Protocol) -> None:
    """Refuse a protocol that fits scaling and selection on its test recordings, too."""
    if not protocol.is_nested:
        raise ValueError(f"protocol is {protocol.name!r}. Expected one whose test recordings stay unseen")


def fewest(protocol: Protocol, table: "pd.DataFrame") -> int:
    """Return the number of recordings (or runs, as the protocol counts) of the surface that has fewest."""
    units = table[["surface"]].assign(unit=protocol.clusters(table))
    return int(units.groupby("surface")["unit"].nunique().min())
