"""Evaluation protocols: which recordings train and which test; windows of one recording are never parted."""

import functools
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.model_selection import LeaveOneGroupOut, StratifiedGroupKFold, StratifiedKFold

from texclass.evaluation.windows import asked, parents
from texclass.reporting.wording import counted

Indices = NDArray[np.intp]
Split = tuple[Indices, Indices]
Splitter = Callable[[pd.DataFrame, int, int], tuple[Split, ...]]
UNSEEN_FOLDS = 5
"""Folds of `splits_of` where a protocol draws them; fewer where a material has fewer recordings (or runs)."""
N_SHOTS, N_STARTS = 3, 4
"""Repetitions of each material that train under `few-shot`, and how many starts it has at most."""
LABELS = ("material", "operator", "session", "repetition")
"""What recordings can be chosen by."""
RANGE = re.compile(r"(\d{1,9})-(\d{1,9})")
"""Repetitions 1-20."""


def runs(table: pd.DataFrame) -> "pd.Series[str]":
    """Return the run (session) of each row; its recording, unless every row names a session."""
    n_sessions = table["session"].nunique(dropna=True)
    known = table["session"].notna().all() and n_sessions > 1
    return table["session"].astype(str) if known else parents(table)


@dataclass(frozen=True)
class Protocol:
    """A named way to evaluate.

    Attributes
    ----------
    name
        As given on the command line.
    description
        One line for the report.
    splitter
        (table, n_folds, seed) -> (train, test) row numbers for each fold; see `split`.
    nested
        Whether scaling and selection are fitted inside each fold. Only `paper` is not.
    drawn
        Whether the seed draws the folds, so that another seed gives others.
    unit
        "recording" or "run": what is never parted, and votes when it holds several rows.
    leaves_out
        The label whose groups are left out in turn, if any: then they are what is independent. "operator"
        stands for sessions, too, if the table names sessions and no operators.
    several_starts
        Whether the same recordings are tested after several trainings, each of few others.
    """

    name: str
    description: str
    splitter: Splitter
    nested: bool = True
    drawn: bool = False
    unit: Literal["recording", "run"] = "recording"
    leaves_out: str = ""
    several_starts: bool = False

    def split(self, table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
        """Return (train, test) row numbers for each fold. Rows may be windows of recordings.

        Windows between others have no say in the folds: they train where their recording does.
        """
        rows, recording = np.flatnonzero(asked(table)), parents(table)
        if len(rows) == len(table):
            return self.splitter(table, n_folds, seed)
        found = self.splitter(table.iloc[rows].reset_index(drop=True), n_folds, seed)
        return tuple(
            (np.flatnonzero(recording.isin(recording.iloc[rows[train]])), rows[test]) for train, test in found
        )

    def clusters(self, table: pd.DataFrame) -> NDArray[np.str_]:
        """Return which `unit` each row belongs to."""
        return (runs if self.unit == "run" else parents)(table).to_numpy(dtype=str)

    def independent(self, table: pd.DataFrame) -> tuple[str, NDArray[np.str_]]:
        """Return what an interval or a test is taken over, and which of them each row belongs to.

        Operators (or sessions) where they are left out, else the `unit`.
        """
        group = left_out_in_turn(table) if self.leaves_out == "operator" else self.leaves_out
        return (group, table[group].to_numpy(dtype=str)) if group else (self.unit, self.clusters(table))


def of_recordings(split: Splitter) -> Splitter:
    """Let a split of recordings split their windows, too: each window goes where its recording goes."""

    @functools.wraps(split)
    def of_rows(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
        of_row, recording_ids = pd.factorize(parents(table))
        if len(recording_ids) == len(table):
            return split(table, n_folds, seed)
        _, first = np.unique(of_row, return_index=True)
        recordings = table.iloc[first].assign(recording_id=recording_ids).reset_index(drop=True)
        return tuple(
            (np.flatnonzero(np.isin(of_row, train)), np.flatnonzero(np.isin(of_row, test)))
            for train, test in split(recordings, n_folds, seed)
        )

    return of_rows


@of_recordings
def stratified(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Split recordings into folds with equal shares of each material.

    Raises
    ------
    ValueError
        If a material has fewer recordings than there are folds, or there is one material.
    """
    _require(table["material"].value_counts(), n_folds, "recording")
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=seed)
    return tuple(folds.split(table, table["material"]))


def grouped_by_run(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Split runs into folds with about equal shares of each material; no run both trains and tests.

    Raises
    ------
    ValueError
        If a material has fewer runs than there are folds, or a run's absence leaves a material untrained.
    """
    run = runs(table)
    n_runs = run.groupby(table["material"]).nunique()
    _require(n_runs, n_folds, "run")
    folds = StratifiedGroupKFold(n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        # A material with fewer rows than folds: the rule above has been kept, in runs.
        warnings.filterwarnings("ignore", message="The least populated class", category=UserWarning)
        split = tuple(s for s in folds.split(table, table["material"], run) if s[1].size)
    for number, (train, test) in enumerate(split, start=1):
        _require_known(table, train, test, f"outside fold {number}")
    return split


@of_recordings
def leave_operator_out(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Test on each operator in turn (each session, if the table names sessions and no operators).

    Raises
    ------
    ValueError
        If there are not two groups, or a material would be tested without having been trained.
    """
    _require(table["material"].value_counts())
    group = left_out_in_turn(table)
    if group is None:
        raise ValueError(
            f"the dataset names {table['operator'].nunique()} operators and {table['session'].nunique()} "
            "sessions; the protocol `operator` needs at least 2 of one of them, named for every recording"
        )
    return _leave_out(group, table, n_folds, seed)


def left_out_in_turn(table: pd.DataFrame) -> str | None:
    """Return "operator", or "session" if operators are not named; None if neither has two groups."""
    known = (name for name in ("operator", "session") if table[name].notna().all())
    return next((name for name in known if table[name].nunique() >= 2), None)


@of_recordings
def first_half_trains(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Train on the first half of each material's repetitions, test on the second (the larger, if odd).

    Raises
    ------
    ValueError
        If repetitions are not numbered, or a material has only one recording.
    """
    counts = table["material"].value_counts()
    missing = table["repetition"].isna()
    if missing.any():
        raise ValueError(
            f"recording {table.loc[missing, 'recording_id'].iloc[0]} has no repetition number; the protocol "
            "`blocks` needs it on each"
        )
    _require(counts, 2, protocol="blocks")
    rank = table.groupby("material")["repetition"].rank(method="first").to_numpy(dtype=np.float64)
    half = table["material"].map(counts // 2).to_numpy(dtype=np.intp)
    return ((np.flatnonzero(rank <= half), np.flatnonzero(rank > half)),)


def few_train(n_shots: int, table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Train on few repetitions of each material in a row, from several starts on; test on much later ones.

    One start says little: a sensor warms up, a hand learns. Starts are a quarter of the first half of the
    repetitions apart, as many of `N_STARTS` as leave `n_shots` of them within that half: of forty, three
    train from 1, 6, 11 and 16 on. The third and the fourth quarter test, each a fold of every start, so that
    every start has the same tests, and none trains on what comes after one. Where a recording has no
    number, recordings (or runs) are drawn with the seed as often, and the others test.

    Raises
    ------
    ValueError
        If a material has fewer than twice as many numbered repetitions as train, or no run besides those.
    """
    if table["repetition"].isna().any():
        return _drawn_train(table, n_shots, seed)
    counts = table["material"].value_counts()
    _require(counts, 2 * n_shots, protocol="few-shot")
    rank = table.groupby("material")["repetition"].rank(method="first").to_numpy(dtype=np.float64)
    count = table["material"].map(counts).to_numpy(dtype=np.intp)
    half, fewest_early = count // 2, int(counts.min()) // 2
    later = half + (count - half) // 2
    tests = [np.flatnonzero(part) for part in ((rank > half) & (rank <= later), rank > later)]
    apart = max(1, fewest_early // N_STARTS)
    starts = [1 + k * apart for k in range(N_STARTS) if k * apart + n_shots <= fewest_early]
    trains = [np.flatnonzero((rank >= start) & (rank < start + n_shots)) for start in starts]
    return tuple((train, test) for train in trains for test in tests if test.size)


def _drawn_train(table: pd.DataFrame, n_shots: int, seed: int) -> tuple[Split, ...]:
    """Train on so many runs of each material, drawn `N_STARTS` times; test on all others."""
    each = pd.DataFrame({"material": table["material"], "run": runs(table)})
    drawable = each.drop_duplicates().sort_values(["material", "run"])
    _require(drawable["material"].value_counts(), n_shots + 1, "run", protocol="few-shot")
    rng, found = np.random.default_rng(seed), []
    for _ in range(N_STARTS):
        drawn = drawable.groupby("material").sample(n_shots, random_state=rng)
        trains = each.merge(drawn, how="left", indicator=True)["_merge"].eq("both").to_numpy()
        found.append((np.flatnonzero(trains), np.flatnonzero(~trains)))
    return tuple(found)


def n_trainings(splits: Sequence[Split]) -> int:
    """Return how many different training parts splits have."""
    return len({train.tobytes() for train, _ in splits})


def _few_shot(name: str, n_shots: int) -> Protocol:
    told = (
        f"{counted(n_shots, 'repetition')} of each material in a row train, from several starts in the first "
        "half on; third and fourth quarter of its repetitions test (without numbers: runs that are drawn "
        "train, the others test)"
    )
    split = of_recordings(functools.partial(few_train, n_shots))
    return Protocol(name, told, split, several_starts=True)


PROTOCOLS = {
    p.name: p
    for p in (
        Protocol(
            "recording",
            "stratified folds over recordings; scaling and selection fitted inside each fold",
            stratified,
            drawn=True,
        ),
        Protocol(
            "operator",
            "leave one operator (or session) out; scaling and selection fitted inside each fold",
            leave_operator_out,
            leaves_out="operator",
        ),
        Protocol(
            "blocks",
            "first half of each material's repetitions trains, second half tests",
            first_half_trains,
        ),
        _few_shot("few-shot", N_SHOTS),
        Protocol(
            "run",
            "stratified folds over runs (sessions; recordings, where none are named): no run both trains and "
            "tests; scaling and selection fitted inside each fold",
            grouped_by_run,
            drawn=True,
            unit="run",
        ),
        Protocol(
            "paper",
            "stratified folds as in `recording`, but scaling and selection are fitted once on ALL "
            "recordings, test folds included: optimistic, for comparison with the paper only",
            stratified,
            nested=False,
            drawn=True,
        ),
    )
}


LEAVE_OUT, FEW_SHOT, TO = "leave-out ", "few-shot ", " -> "
"""What the names of protocols by label are made with."""


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
    if name.startswith(LEAVE_OUT):
        label = _label(name.removeprefix(LEAVE_OUT))
        told = f"leave one {label} out; scaling and selection fitted inside each fold"
        return Protocol(name, told, of_recordings(functools.partial(_leave_out, label)), leaves_out=label)
    if re.fullmatch(f"{FEW_SHOT}[1-9][0-9]{{0,5}}", name):
        return _few_shot(name, int(name.removeprefix(FEW_SHOT)))
    train, arrow, test = name.partition(TO)
    if not arrow:
        raise ValueError(
            f"no protocol is named {name!r}; the protocols are {', '.join(PROTOCOLS)}, {FEW_SHOT}NUMBER, "
            f"{LEAVE_OUT}LABEL, LABEL=VALUES{TO}LABEL=VALUES"
        )
    for chosen in (train, test):
        _terms(chosen)
    return Protocol(
        name, f"trains on {train}, tests on {test}", functools.partial(_these_to_those, train, test)
    )


def repeated(
    protocol: Protocol, table: pd.DataFrame, n_folds: int, n_repeats: int, seed: int
) -> tuple[tuple[Split, ...], ...]:
    """Return the splits of repeated cross-validation: those of seed, seed + 1, ....

    Raises
    ------
    ValueError
        If there is no repeat, or several of a protocol that splits in one way only.
    """
    if n_repeats < 1 or (n_repeats > 1 and not protocol.drawn):
        drawn = ", ".join(p.name for p in PROTOCOLS.values() if p.drawn)
        raise ValueError(
            f"{n_repeats} repeats of the protocol `{protocol.name}`; "
            f"the rule is 1, or more of a protocol that draws its folds ({drawn})"
        )
    return tuple(protocol.split(table, n_folds, seed + r) for r in range(n_repeats))


def splits_of(protocol: Protocol, table: pd.DataFrame, seed: int) -> tuple[Split, ...]:
    """Return how a protocol holds the rows of a table out.

    Raises
    ------
    ValueError
        If it cannot, or lets test recordings be seen.
    """
    require_unseen(protocol)
    return protocol.split(table, max(2, min(UNSEEN_FOLDS, fewest(protocol, table))), seed)


def require_unseen(protocol: Protocol) -> None:
    """Refuse a protocol that fits scaling and selection on its test recordings, too."""
    if not protocol.nested:
        raise ValueError(f"protocol is {protocol.name!r}; the rule is one whose test recordings stay unseen")


def fewest(protocol: Protocol, table: pd.DataFrame) -> int:
    """Return the number of recordings (or runs, as the protocol counts) of the material that has fewest."""
    unit = pd.Series(protocol.clusters(table), index=table.index)
    return int(unit.groupby(table["material"]).nunique().min())


def _label(name: str) -> str:
    if name not in LABELS:
        raise ValueError(f"no label of recordings is {name!r}; the rule is one of {', '.join(LABELS)}")
    return name


def _terms(chosen: str) -> list[tuple[str, list[str]]]:
    """Return label and values of each term of "repetition=1-20,25 & session=a"."""
    terms = [term.partition("=") for term in chosen.split("&")]
    if wrong := next((label for label, equals, values in terms if not (equals and values.strip())), None):
        raise ValueError(
            f"recordings are chosen by {wrong.strip()!r}; the rule is LABEL=VALUE,VALUE or LABEL=1-20"
        )
    return [(_label(label.strip()), [v.strip() for v in values.split(",")]) for label, _, values in terms]


def _chosen(table: pd.DataFrame, chosen: str) -> NDArray[np.bool_]:
    """Return which rows are of the recordings that labels choose."""
    mask = np.ones(len(table), dtype=bool)
    for label, values in _terms(chosen):
        present = table[label].astype("string").fillna("")
        numbers = pd.to_numeric(present, errors="coerce")
        one = np.zeros(len(table), dtype=bool)
        for value in values:
            span = RANGE.fullmatch(value)
            if span and not (present == value).any():
                found = numbers.between(int(span[1]), int(span[2]))
            else:
                found = present == value
            if not found.any():
                known = ", ".join(sorted(set(present) - {""}, key=lambda v: (len(v), v))[:8]) or "none"
                raise ValueError(f"no recording has {label} {value!r}; there are {known}")
            one |= found.to_numpy(dtype=bool)
        mask &= one
    return mask


def _these_to_those(train: str, test: str, table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Train on the recordings that some labels choose, test on those that others do."""
    trains, tests = _chosen(table, train), _chosen(table, test)
    if not trains.any() or not tests.any():
        raise ValueError(
            f"no recording is of {test if trains.any() else train}; the rule is some of each part"
        )
    if (both := trains & tests).any():
        named = table["recording_id"][both].iloc[0]
        raise ValueError(f"recording {named} is of {train} and of {test}; the rule is one of them")
    split = np.flatnonzero(trains), np.flatnonzero(tests)
    _require(table["material"].value_counts())
    _require_known(table, *split, f"in {train}")
    return (split,)


def _leave_out(label: str, table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Test on each group of a label in turn."""
    if table[label].isna().any() or table[label].nunique() < 2:
        found = f"{table[label].nunique()} {label}s, {table[label].isna().sum()} recordings without one"
        raise ValueError(
            f"the dataset names {found}; leaving one out needs at least 2, named for every recording"
        )
    split = tuple(LeaveOneGroupOut().split(table, groups=table[label]))
    for train, test in split:
        _require_known(table, train, test, f"without {label} {table[label].iloc[test[0]]}")
    return split


def _require(counts: "pd.Series[int]", least: int = 1, unit: str = "recording", protocol: str = "") -> None:
    """Refuse fewer than two materials, and one with fewer recordings (or runs) than folds, or than needed."""
    if len(counts) < 2:
        raise ValueError(f"the dataset has {len(counts)} material; classification needs at least 2")
    if (n := int(counts.min())) < least:
        if protocol:
            rule = f"the protocol `{protocol}` needs {least} of each"
        else:
            rule = f"{least} folds{' grouped by run' * (unit == 'run')} need at least {least} of each"
            rule += f"; 2 to {n} folds are possible: `--folds {n}`" if n >= 2 else ""
        raise ValueError(f"material {counts.idxmin()} has {n} {unit}{'' if n == 1 else 's'}; {rule}")


def _require_known(table: pd.DataFrame, train: Indices, test: Indices, how: str) -> None:
    untrained = sorted(set(table["material"].iloc[test]) - set(table["material"].iloc[train]))
    if untrained:
        raise ValueError(
            f"material {untrained[0]} has no recording {how}; "
            "the protocol needs every tested material trained"
        )
