"""Evaluation protocols: how recordings are split into training sets and test sets.

The command line, pipelines, reports and documentation use the names and titles defined here. The functions
that split rows are in `texclass.evaluation.splits`. That module is imported on first use, so that a command
that lists the protocols imports neither pandas nor scikit-learn.
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

Terms = list[tuple[str, list[str]]]
"""Conditions (label, values) that must all hold: the parsed form of "repetition=1-20,25 & session=a"."""


def _terms(text: str) -> Terms:
    """Parse conditions such as "repetition=1-20,25 & session=a"."""
    terms = [term.partition("=") for term in text.split("&")]
    for label, equals, values in terms:
        if not (label.strip() and equals and values.strip()):
            raise ValueError(
                f"cannot select recordings by {label.strip()!r}. Expected LABEL=VALUE,VALUE or LABEL=1-20"
            )
    return [(label.strip(), [v.strip() for v in values.split(",")]) for label, _, values in terms]


class Protocol(ABC):
    """Protocol that splits recordings into training sets and test sets.

    Attributes
    ----------
    name : str
        Name on the command line, in pipelines and in results.
    title : str
        Short title for reports.
    description : str
        Description in one line, for reports.
    choice : str
        Syntax of the name on the command line, for protocols with parameters.
    needs : tuple of str
        Required labels, which must have a value for every recording. The protocol "operator" needs only one.
    unit : {"recording", "run", "window"}
        Unit whose rows are never divided between training set and test set. The predictions of these rows are
        combined by majority vote.
    separates_recordings : bool
        Whether all windows of a recording are in the same set. It is False only for the protocol
        "shuffled-windows".
    is_random : bool
        Whether the folds depend on the seed.
    is_nested : bool
        Whether scaling and selection are fitted inside each fold. It is False only for the protocol "paper".

    Examples
    --------
    >>> from texclass.evaluation import PROTOCOLS
    >>> isinstance(PROTOCOLS["recording"], Protocol)
    True
    """

    name: str
    title: str
    description: str
    choice: ClassVar[str] = ""
    needs: tuple[str, ...] = ()
    unit: Literal["recording", "run", "window"] = "recording"
    separates_recordings: bool = True
    is_random: bool = False
    is_nested: bool = True

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.name}>"

    def split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        """Return (train, test) row indices for each fold.

        Parameters
        ----------
        table : DataFrame
            Labels of recordings or windows, one recording or window per row.
        n_folds : int
            Number of folds, for protocols that draw folds.
        seed : int
            Random seed, for protocols that draw folds.

        Returns
        -------
        tuple of (ndarray, ndarray)
            Row indices of training set and test set of each fold.

        Raises
        ------
        ValueError
            If the table cannot be split by this protocol.
        """
        from texclass.evaluation.splits import split_testable

        return split_testable(lambda rows: self._split(rows, n_folds, seed), table)

    @abstractmethod
    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        """Return (train, test) row indices for each fold of a table without overlapping windows."""

    def clusters(self, table: "pd.DataFrame") -> "NDArray[np.str_]":
        """Return the `unit` (recording or run) of each row."""
        from texclass.evaluation.splits import runs
        from texclass.evaluation.windows import parents

        return (runs if self.unit == "run" else parents)(table).to_numpy(dtype=str)

    def independent(self, table: "pd.DataFrame") -> "tuple[str, NDArray[np.str_]]":
        """Return the kind of the independent units of intervals and tests, and the unit of each row."""
        is_in_files = self.unit == "recording" and "file_id" in table
        return "file" if is_in_files else self.unit, self.groups(table)

    def groups(self, table: "pd.DataFrame") -> "NDArray[np.str_]":
        """Return the group of each row that is never divided: its `unit`, or the file of its recording.

        Recordings of several surfaces that were cut from one file are correlated, so they form one group.
        """
        from texclass.evaluation.windows import files

        return files(table).to_numpy(dtype=str) if self.unit == "recording" else self.clusters(table)


class Stratified(Protocol):
    """Protocol that draws stratified folds over recordings."""

    name = "recording"
    title = "folds over recordings"
    description = "stratified folds over recordings; scaling and selection fitted inside each fold"
    is_random = True

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import stratified

        return stratified(table, n_folds, seed)


class Paper(Stratified):
    """Protocol with stratified folds that fits scaling and selection on all recordings, as in the paper."""

    name = "paper"
    title = "the paper's protocol"
    description = (
        "stratified folds as in `recording`, but scaling and selection are fitted once on ALL "
        "recordings, test folds included: optimistic, for comparison with the paper only"
    )
    is_nested = False


class Grouped(Protocol):
    """Protocol that draws folds over runs. A run is a session, or a recording if sessions are missing."""

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


class ShuffledWindows(Protocol):
    """Protocol that draws stratified folds over windows, as many publications do.

    Windows of one recording are in the training set and in the test set, so the accuracy is optimistic.
    Overlapping training windows are not used, because they would contain parts of the test windows.
    """

    name = "shuffled-windows"
    title = "folds over shuffled windows (optimistic)"
    description = (
        "stratified folds over windows, whichever recording they are from: windows of one recording are in "
        "training set and test set, so the accuracy is optimistic; for comparison with published results only"
    )
    unit = "window"
    separates_recordings = False
    is_random = True

    def split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        """Return (train, test) row indices for each fold, without overlapping training windows."""
        from texclass.evaluation.windows import is_testable

        rows = is_testable(table).to_numpy().nonzero()[0]
        splits = self._split(table.iloc[rows].reset_index(drop=True), n_folds, seed)
        return tuple((rows[train], rows[test]) for train, test in splits)

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import shuffled_windows

        return shuffled_windows(table, n_folds, seed)

    def clusters(self, table: "pd.DataFrame") -> "NDArray[np.str_]":
        """Return the id of each window."""
        return table["recording_id"].to_numpy(dtype=str)

    def independent(self, table: "pd.DataFrame") -> "tuple[str, NDArray[np.str_]]":
        """Return "recording" (or "file", if recordings were cut from files), and its id for each window."""
        from texclass.evaluation.windows import files

        return "file" if "file_id" in table else "recording", files(table).to_numpy(dtype=str)


class LeaveOneOut(Protocol):
    """Protocol that tests the recordings with each value of a label once. Values are independent units.

    Parameters
    ----------
    *labels : str
        Label. If there are several, each combination of their values is tested once.
    """

    choice = "leave-out LABEL[,LABEL]"

    def __init__(self, *labels: str) -> None:
        if not all(labels) or len({*labels}) < len(labels):
            raise ValueError(f"cannot leave out {','.join(labels)!r}. Expected different labels: LABEL,LABEL")
        self.needs = labels
        self.unit_left_out = labels[0] if len(labels) == 1 else f"{'-'.join(labels)} combination"
        self.name = f"leave-out {','.join(labels)}"
        self.title = f"leave one {self.unit_left_out} out"
        self.description = f"{self.title}; scaling and selection fitted inside each fold"

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import leave_one_out

        return leave_one_out(table, self.needs)

    def independent(self, table: "pd.DataFrame") -> "tuple[str, NDArray[np.str_]]":
        """Return the held-out label (or combination of labels) and its value for each row."""
        from texclass.evaluation.splits import label_combinations

        return self.unit_left_out, label_combinations(table, self.needs).to_numpy(dtype=str)


class Operator(LeaveOneOut):
    """Protocol that leaves one operator out, or one session if operators are missing."""

    choice = ""

    def __init__(self) -> None:
        super().__init__("operator")
        self.name, self.needs = "operator", ("operator", "session")
        self.description = (
            "leave one operator (or session) out; scaling and selection fitted inside each fold"
        )

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import leave_one_out, left_out_label

        return leave_one_out(table, [left_out_label(table, self.needs)])

    def independent(self, table: "pd.DataFrame") -> "tuple[str, NDArray[np.str_]]":
        """Return "operator" or "session", and its value for each row."""
        from texclass.evaluation.splits import left_out_label

        label = left_out_label(table, self.needs)
        return label, table[label].to_numpy(dtype=str)


class Chronological(Protocol):
    """Protocol that trains on the first half of the repetitions and tests on the second half."""

    name = "chronological"
    title = "first half of the repetitions to second half"
    description = "first half of each surface's repetitions trains, second half tests"
    needs = ("repetition",)

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import chronological

        return chronological(table)


class FewShot(Protocol):
    """Protocol that trains on a few repetitions of each surface and tests on the later half.

    Several training sets begin at different repetitions; see `few_shot`.

    Parameters
    ----------
    n_shots : int
        Number of training repetitions per surface (default 3).
    """

    choice = "few-shot NUMBER"
    n_starts: ClassVar[int] = 4
    """Largest number of starting points, one for each quarter of the first half of the repetitions."""

    def __init__(self, n_shots: int = 3) -> None:
        self.n_shots = n_shots
        self.name = "few-shot" if n_shots == 3 else f"few-shot {n_shots}"
        self.title = f"{counted(n_shots, 'repetition')}, several starts, to second half"
        self.description = (
            f"trains on {counted(n_shots, 'consecutive repetition')} of each surface, with several starts in "
            "the first half; tests on the third and the fourth quarter (without repetition numbers: trains "
            "on runs drawn at random, tests on the others)"
        )

    def _split(self, table: "pd.DataFrame", n_folds: int, seed: int) -> "Splits":
        from texclass.evaluation.splits import few_shot

        return few_shot(table, self.n_shots, self.n_starts, seed)


class ByLabels(Protocol):
    """Protocol that selects the training set and the test set by the values of labels."""

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
    for protocol in (
        Stratified(),
        Operator(),
        Chronological(),
        FewShot(),
        Grouped(),
        Paper(),
        ShuffledWindows(),
    )
}
"""Protocols without parameters by name, in display order."""


def find_protocol(name: str) -> Protocol:
    """Return the protocol with this name, which may contain parameters.

    Parameters
    ----------
    name : str
        Name in `PROTOCOLS`, or a name with parameters: "few-shot 1" (one training repetition per surface),
        "leave-out speed" (each value of a label is the test set once), "leave-out speed,force" (each
        combination of values), or "repetition=1-20 -> repetition=31-40" (training set and test set selected
        by labels). In the last form, "operator=2,5 & force=0.5-2" selects the recordings of operators 2 and 5
        with forces from 0.5 to 2. Labels are those of the dataset; they are checked when it is split.

    Returns
    -------
    Protocol
        The protocol.

    Raises
    ------
    ValueError
        If the name is unknown.

    Examples
    --------
    >>> find_protocol("leave-out speed").title
    'leave one speed out'
    >>> find_protocol("leave-out speed,force").title
    'leave one speed-force combination out'
    """
    if name in PROTOCOLS:
        return PROTOCOLS[name]
    if match := re.fullmatch("few-shot ([1-9][0-9]{0,5})", name):
        return FewShot(int(match[1]))
    if name.startswith("leave-out "):
        return LeaveOneOut(*(label.strip() for label in name.removeprefix("leave-out ").split(",")))
    train, arrow, test = name.partition(" -> ")
    if arrow:
        return ByLabels(train, test)
    choices = (kind.choice for kind in (FewShot, LeaveOneOut, ByLabels))
    raise ValueError(f"unknown protocol {name!r}. Expected one of {', '.join((*PROTOCOLS, *choices))}")


def repeated_splits(
    protocol: Protocol, table: "pd.DataFrame", n_folds: int, n_repeats: int, seed: int
) -> "tuple[Splits, ...]":
    """Return the splits of repeated cross-validation, whose seeds are consecutive integers.

    Parameters
    ----------
    protocol : Protocol
        Protocol that splits the table.
    table : DataFrame
        Labels of recordings or windows, one per row.
    n_folds : int
        Number of folds, for protocols that draw folds.
    n_repeats : int
        Number of repeats.
    seed : int
        Random seed of the first repeat.

    Returns
    -------
    tuple of splits
        Splits of each repeat.

    Raises
    ------
    ValueError
        If `n_repeats` is less than 1, or more than 1 for a protocol without random folds.

    Examples
    --------
    >>> import pandas as pd
    >>> surfaces = ["oak"] * 3 + ["cork"] * 3
    >>> table = pd.DataFrame({"recording_id": range(6), "surface": surfaces})
    >>> repeats = repeated_splits(find_protocol("recording"), table, n_folds=3, n_repeats=2, seed=0)
    >>> [len(splits) for splits in repeats]
    [3, 3]
    """
    if n_repeats < 1 or (n_repeats > 1 and not protocol.is_random):
        random_protocols = ", ".join(p.name for p in PROTOCOLS.values() if p.is_random)
        raise ValueError(
            f"n_repeats is {n_repeats} for the protocol `{protocol.name}`. Expected 1; protocols with random "
            f"folds ({random_protocols}) also allow more"
        )
    return tuple(protocol.split(table, n_folds, seed + r) for r in range(n_repeats))


def make_splits(protocol: Protocol, table: "pd.DataFrame", seed: int, max_folds: int = 5) -> "Splits":
    """Return the splits of a protocol. A protocol that draws folds draws at most `max_folds`.

    Raises
    ------
    ValueError
        If the table cannot be split, or the protocol fits scaling and selection on test recordings.
    """
    require_nested(protocol)
    return protocol.split(table, max(2, min(max_folds, min_per_surface(protocol, table))), seed)


def require_nested(protocol: Protocol) -> None:
    """Raise ValueError for a protocol that fits scaling and selection on its test recordings."""
    if not protocol.is_nested:
        raise ValueError(
            f"protocol {protocol.name!r} fits scaling and selection on the test recordings. Use a protocol "
            "that does not, for example 'recording'"
        )


def min_per_surface(protocol: Protocol, table: "pd.DataFrame") -> int:
    """Return the smallest number of recordings (or runs, depending on the protocol) over all surfaces."""
    units = table[["surface"]].assign(unit=protocol.groups(table))
    return int(units.groupby("surface")["unit"].nunique().min())
