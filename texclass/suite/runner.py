"""Run the suite: every method on every available dataset, in parallel, with finished cells kept."""

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from texclass import shipped
from texclass.evaluation.workers import Progress, run_parallel
from texclass.loaders.cards import AnyCard, DeclaredProtocol, StoredCard, read_card
from texclass.loaders.places import find_folder
from texclass.suite.cells import COLUMNS, Cell, SuiteSettings, evaluate_cell
from texclass.suite.methods import Method

CELL_KEYS = ["dataset", "question", "protocol", "window_s", "method"]
"""Columns that identify the results of a method under a protocol."""
SLOW_DATASETS = ("simulated69",)
"""Shipped datasets that are evaluated only by name, because they take hours."""


def available_datasets() -> tuple[list[str], dict[str, str]]:
    """Return the shipped datasets that can be evaluated, and the reason why each of the others cannot."""
    available, unavailable = list[str](), dict[str, str]()
    for name in shipped.names("datasets"):
        card = read_card(name)
        if not card.protocols:
            unavailable[name] = "its card declares no protocol"
        elif name in SLOW_DATASETS:
            unavailable[name] = f"takes hours; select it with --datasets {name}"
        else:
            try:
                if isinstance(card, StoredCard):
                    find_folder(card)
                available.append(name)
            except FileNotFoundError as error:
                unavailable[name] = str(error)
    return available, unavailable


def list_cells(datasets: Iterable[str], methods: Sequence[Method]) -> list[Cell]:
    """Return the cells of the suite: a method, a dataset, and its protocols with the same windows.

    Parameters
    ----------
    datasets : iterable of str
        Names of shipped cards, or paths of cards.
    methods : sequence of Method
        Methods.

    Raises
    ------
    ValueError
        If a card declares no protocol.
    """
    groups: list[tuple[str, tuple[DeclaredProtocol, ...]]] = []
    for name in datasets:
        card: AnyCard = read_card(name)
        if not card.protocols:
            raise ValueError(
                f"{card.path}: the card declares no protocol. Add [[protocols]] with the keys question and "
                "protocol"
            )
        by_window: dict[tuple[float | None, int | None], list[DeclaredProtocol]] = {}
        for protocol in card.protocols:
            by_window.setdefault((protocol.window_s, protocol.max_windows), []).append(protocol)
        groups += [(name, tuple(protocols)) for protocols in by_window.values()]
    return [Cell(name, protocols, method) for method in methods for name, protocols in groups]


def run_suite(
    datasets: Iterable[str],
    methods: Sequence[Method],
    settings: SuiteSettings,
    *,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Evaluate methods on datasets, and return one row per dataset, protocol, method and fold.

    Each cell is evaluated by one process, which loads one recording at a time. A finished cell is not
    evaluated again unless its code, method or dataset has changed. A cell that failed is tried again.

    Parameters
    ----------
    datasets : iterable of str
        Names of shipped cards, or paths of cards.
    methods : sequence of Method
        Methods.
    settings : SuiteSettings
        Folder, interpreter of the baselines, and time limit.
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Function called with (done, total, "cells").

    Returns
    -------
    DataFrame
        Columns `COLUMNS`, of all finished and failed cells.
    """
    cells = list_cells(datasets, methods)
    calls = [partial(evaluate_cell, cell, settings) for cell in cells]
    options = {"n_jobs": n_jobs, "progress": progress, "stage": "cells", "total": len(calls)}
    paths = [path for paths in run_parallel(calls, **options) for path in paths]  # type: ignore[arg-type]
    return join_rows(read_table(path) for path in paths)


def join_rows(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Return the rows of several tables of the suite in a fixed order.

    If several tables have results of a method on a dataset under a protocol, the first of them is used.
    """
    tables = list(tables)
    numbered = pd.concat([one.assign(table=k) for k, one in enumerate(tables) if len(one)], ignore_index=True)
    first = numbered.groupby(CELL_KEYS, dropna=False)["table"].transform("min")
    rows = numbered[numbered["table"] == first].drop(columns="table")
    order = ["is_simulated", *CELL_KEYS, "fold"]
    return rows.sort_values(order, kind="stable", ignore_index=True)


def read_table(path: Path | str) -> pd.DataFrame:
    """Read a table of the suite.

    Raises
    ------
    ValueError
        If the file is not a table of the suite.
    """
    try:
        table = pd.read_csv(
            path, dtype=dict.fromkeys(TEXT_COLUMNS, str), keep_default_na=False, na_values=[""]
        )
    except (ValueError, UnicodeError) as error:
        raise ValueError(f"{path}: not a table of the suite ({error})") from error
    if missing := [column for column in COLUMNS if column not in table]:
        raise ValueError(
            f"{path}: missing columns {', '.join(missing)}. Expected a table written by `texclass suite`"
        )
    return table[list(COLUMNS)].astype({"is_simulated": bool})


TEXT_COLUMNS = (
    "dataset", "question", "protocol", "method", "title", "choice", "unit", "unit_hits", "status", "message",
    "licence", "dataset_hash", "folds_hash", "units_hash", "method_hash", "code_hash", "versions", "author",
)  # fmt: skip
"""Columns that contain text, also where a text looks like a number."""
