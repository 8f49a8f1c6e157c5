"""Model files: a skops archive with a manifest and a digest beside it."""

import hashlib
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from texclass.experiment.trusted import check_archive, foreign_in, load_trusted, members_of, read_bounded
from texclass.recognition.manifest import Manifest, read_manifest
from texclass.tradeoff.deploy import Recogniser

MANIFEST = "manifest.json"
BESIDE = frozenset({MANIFEST})


class ModelFileError(ValueError):
    """A model file cannot be used; the message names the file and the rule."""


def write_model_file(path: str | Path, document: Mapping[str, Any], manifest: Manifest) -> None:
    """Write a model file: complete, or not at all.

    Raises
    ------
    ValueError
        If it would hold a class that nobody could load again.
    """
    import skops.io

    data = skops.io.dumps(dict(document))
    if foreign := foreign_in(data):
        raise ValueError(f"{path}: {foreign[0]} cannot be saved; the rule is classes that load safely")
    stated = json.loads(manifest.to_json())
    stated["digest"] = _digest(stated, members_of(data))
    buffer = io.BytesIO(data)
    with ZipFile(buffer, "a") as archive:
        archive.writestr(MANIFEST, json.dumps(stated, sort_keys=True, indent=1))
    write_whole(Path(path), buffer.getvalue())


def write_whole(path: Path, data: bytes) -> None:
    """Write a file: complete, or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    unfinished.write_bytes(data)
    unfinished.replace(path)


def read_manifest_of(path: str | Path) -> Manifest:
    """Return what a model file says of itself, its digest checked; no object is made of it.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ModelFileError
        If it is no whole model file, was changed, or is of a newer format.
    """
    return _checked(path)[0]


def read_model_file(path: str | Path) -> tuple[Mapping[str, Any], Manifest]:
    """Return the document and the manifest of a model file; nothing but known classes is ever made of it.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ModelFileError
        If it is no whole model file, was changed, is of a newer format, or names a class that is not trusted.
    """
    manifest, data = _checked(path)
    try:
        document = load_trusted(data, beside=BESIDE)
    except ValueError as error:
        raise ModelFileError(f"{path}: {error}") from error
    if not isinstance(document, dict):
        raise ModelFileError(f"{path}: holds a {type(document).__name__}; the rule is a model of texclass")
    return document, manifest


def _checked(path: str | Path) -> tuple[Manifest, bytes]:
    try:
        data = read_bounded(path)
        check_archive(data, BESIDE)
        members = dict(members_of(data))
        if MANIFEST not in members:
            raise ValueError("it has no manifest; the rule is a file that `texclass train` wrote")
        text = members.pop(MANIFEST)
        manifest = read_manifest(text)
        stated = json.loads(text)
        if stated.pop("digest", None) != _digest(stated, members):
            raise ValueError("it was changed since it was written: its digest is another; train it again")
    except OSError:
        raise
    except ValueError as error:
        raise ModelFileError(f"{path}: {error}") from error
    return manifest, data


def _digest(manifest: Mapping[str, Any], members: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of facts and members; it tells of damage and edits, and not who wrote the file."""
    digest = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode())
    for name in sorted(members):
        digest.update(f"\0{name}\0{len(members[name])}\0".encode() + members[name])
    return digest.hexdigest()


def unsafe_classes(recogniser: Recogniser) -> list[str]:
    """Return the classes of a fitted recogniser that nobody could load again, sorted."""
    import skops.io

    return foreign_in(skops.io.dumps(recogniser.document()))
