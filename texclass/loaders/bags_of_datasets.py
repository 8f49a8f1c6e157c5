"""Bags as recordings of a dataset: folders that are one bag, bags that hold one recording per topic."""

import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from texclass.loaders import formats
from texclass.recording import RecordingError

Groups = dict[str, str]


def not_recordings(files: Iterable[str]) -> set[str]:
    """Return, of relative names, those that are no recordings themselves.

    A `metadata.yaml` stands for the bag files beside it; without any it is somebody else's.
    """
    paths = [PurePosixPath(name) for name in files]
    holding = {path.parent for path in paths if _is_storage(path)}
    described = {path.parent for path in paths if path.name == formats.BAG_FOLDER}
    return {
        str(path)
        for path in paths
        if (_is_storage(path) and path.parent in described)
        or (path.name == formats.BAG_FOLDER and path.parent not in holding)
    }


def inside_folders(root: Path, names: Iterable[str]) -> list[str]:
    """Return the relative names of the files in those bags that are folders."""
    folders = [(root / name).parent for name in names if PurePosixPath(name).name == formats.BAG_FOLDER]
    return [
        file.relative_to(root).as_posix()
        for folder in folders
        for file in sorted(folder.iterdir())
        if _is_storage(PurePosixPath(file.name))
    ]


def by_topic(
    topic: str | None, path: Path, groups: Groups, left_out: list[str], *, skip_bad: bool
) -> list[tuple[str | None, Groups]]:
    """Return (topic, what names tell) of every recording in a file: one, or one per topic that matches.

    Parameters
    ----------
    topic : str or None
        Of a card: a pattern if it has named groups, else a name.
    path : Path
        The file.
    groups : dict
        What the file's name tells.
    left_out : list of str
        Bags that cannot be read are added if `skip_bad`.
    skip_bad : bool
        Go on without them.

    Raises
    ------
    RecordingError
        If a bag cannot be read, or no topic of it matches.
    """
    if not (topic and re.compile(topic).groupindex and formats.is_bag(path)):
        return [(None, groups)]
    try:
        return _matching(topic, path, groups)
    except RecordingError as error:
        if not skip_bad:
            raise
        left_out.append(f"left out: {error}")
        return []


def _matching(pattern: str, path: Path, groups: Groups) -> list[tuple[str | None, Groups]]:
    topics = formats.topics(path)
    found: list[tuple[str | None, Groups]] = []
    for topic in sorted(topics):
        if matched := re.fullmatch(pattern, topic):
            told = {group: text for group, text in matched.groupdict().items() if text is not None}
            recording = f"{groups['recording']}/{topic.strip('/')}"
            found.append((topic, groups | {"recording": recording} | told))
    if not found:
        raise RecordingError(f"{path}: no topic matches {pattern!r}; its topics are {', '.join(topics)}")
    return found


def _is_storage(path: PurePosixPath) -> bool:
    return PurePosixPath(path.name.lower().removesuffix(".zstd")).suffix in (".mcap", ".db3")
