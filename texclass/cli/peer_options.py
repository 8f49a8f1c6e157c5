"""The options of `texclass benchmark` that say how peers are run, and the run itself."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from texclass.cli.options import console, progress_bar

if TYPE_CHECKING:
    from texclass.loaders import Dataset
    from texclass.peers import PeerSettings

PeersOption = Annotated[
    bool,
    typer.Option(
        "--peers",
        help="Run librosa MFCC, TSFEL, tsfresh, catch22, QUANT and the rockets on the same folds, too.",
    ),
]
PeersPythonOption = Annotated[
    Path | None,
    typer.Option(
        help="The interpreter that has the peers and scikit-learn; this one by default (extra `peers`)."
    ),
]
PeersOnlyOption = Annotated[
    str | None, typer.Option(help="Only these peers, separated by commas: mfcc,minirocket.")
]
PeersLimitOption = Annotated[
    int | None,
    typer.Option(help="At most so many recordings: materials are left out whole, for ours as well."),
]
PeersSecondsOption = Annotated[
    float, typer.Option(help="Time limit for each peer, in seconds; the folds it finished count.")
]
PeersSignalsOption = Annotated[
    str,
    typer.Option(
        help="What peers are given: the `same` signals as our features, or `each` channel by itself."
    ),
]


def peer_settings(python: Path | None, only: str | None, seconds: float, signals: str) -> "PeerSettings":
    """Return the settings that the options ask for."""
    from texclass.peers import PeerSettings

    asked: dict[str, Any] = {"time_limit_s": seconds, "signals": signals}
    if python is not None:
        # Not resolved: the interpreter of a virtual environment is a link.
        asked["python"] = python.expanduser().absolute()
    if only is not None:
        asked["names"] = tuple(name.strip() for name in only.split(","))
    return PeerSettings(**asked)


def limited(dataset: "Dataset", limit: int | None) -> "Dataset":
    """Return the dataset, or whole materials of it up to a limit of recordings."""
    from texclass.peers import whole_materials

    return dataset if limit is None else whole_materials(dataset, limit)


def run_peers(
    dataset: "Dataset", definition: Any, result: Any, settings: "PeerSettings", out: Path, **options: Any
) -> None:
    """Compare with peers; print the comparison and write its report."""
    from texclass.peers import compare_with_peers
    from texclass.reporting import peer_table, write_peer_report

    with progress_bar() as progress:
        found = compare_with_peers(dataset, definition, result, settings, **options, progress=progress)
    console().print("", peer_table(found))
    for path in write_peer_report(found, out):
        typer.echo(f"wrote {path}")
