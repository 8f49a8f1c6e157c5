"""Process that fuzzes one reader: `python -m fuzz.worker NAME N SEED FOLDER ENGINE`.

A crash, a hang or too much memory ends this process and nothing else; the input is in the shared memory.
"""

import importlib
import json
import random
import resource
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import texclass

MOST_BYTES = 1 << 16
HEADROOM = 2 << 30
"""Bytes of address space beyond what the valid inputs take."""
GUIDED = ("texclass", "mcap", "rosbags", "openpyxl", "nptdms", "skops", "zipfile", "tomllib")
"""Packages whose branches guide atheris."""


COUNTS = [
    *((name, "u8") for name in ("inputs", "accepted", "refused", "broken", "slowest_bytes", "size")),
    ("slowest_s", "f8"), ("peak_mb", "f8"), ("data", "u1", 1 << 20),
]  # fmt: skip
"""Of one target; `slowest_s` is CPU time, of an input of `slowest_bytes`; `data` (`size`) is at hand."""


def shared_counts(folder: Path) -> np.memmap:
    """Return counts and the input at hand in a mapped file, which outlives a worker."""
    path = folder / "shared"
    return np.memmap(path, COUNTS, "r+" if path.exists() else "w+", shape=())


def main() -> None:
    name, engine, folder = sys.argv[1], sys.argv[5], Path(sys.argv[4])
    n, seed = int(sys.argv[2]), int(sys.argv[3])
    place = folder / "inputs"
    place.mkdir(exist_ok=True)
    run = _guided if engine == "atheris" else _blind
    run(name, n, seed, folder, place)


class Feeder:
    """Checks inputs and stores violations: one input and the count of each finding."""

    def __init__(self, name: str, folder: Path, place: Path) -> None:
        import tempfile

        from fuzz.contract import WATCH, judge
        from fuzz.targets import target_of

        warnings.simplefilter("ignore")
        tempfile.tempdir = str(place)
        self.target, self.place, self.folder = target_of(name), place, folder
        self.seeds = self.target.seeds()
        self._judge = judge
        self.counts = shared_counts(folder)
        outcome = folder / "findings.json"
        self.findings: dict[str, int] = json.loads(outcome.read_text()) if outcome.exists() else {}
        for data in self.seeds:
            verdict = judge(self.target, data, place)
            if verdict.kind not in ("accepted", "refused"):
                print(f"{name}: a seed is {verdict}", file=sys.stderr)
        WATCH.install(place)
        cpu_s = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (cpu_s + HEADROOM, cpu_s + HEADROOM))
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 30, 1 << 30))

    def feed(self, data: bytes) -> None:
        counts = self.counts
        counts["size"] = size = min(len(data), counts["data"].size)
        counts["data"][:size] = np.frombuffer(data, np.uint8, size)  # before the reader has it
        verdict = self._judge(self.target, data, self.place)
        counts["inputs"] += 1
        counts["broken" if verdict.broken else verdict.kind] += 1
        if verdict.broken:
            what = f"{verdict.kind}: {verdict.detail}"
            if what not in self.findings:
                (self.folder / f"finding{len(self.findings)}.bin").write_bytes(data)
            self.findings[what] = self.findings.get(what, 0) + 1
            (self.folder / "findings.json").write_text(json.dumps(self.findings))
        if verdict.seconds > counts["slowest_s"]:
            counts["slowest_s"], counts["slowest_bytes"] = verdict.seconds, len(data)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        counts["peak_mb"] = max(counts["peak_mb"], peak)


def _blind(name: str, n: int, seed: int, folder: Path, place: Path) -> None:
    """Spoil seeds, and what came of them before, at random."""
    feeder, rng = Feeder(name, folder, place), random.Random(seed)
    pool = list(feeder.seeds)
    for _ in range(n):
        data = feeder.target.mutate(rng, rng.choice(pool))[:MOST_BYTES]
        before = int(feeder.counts["accepted"])
        feeder.feed(data)
        if feeder.counts["accepted"] > before and rng.random() < 0.02:
            pool.append(data)
            del pool[len(feeder.seeds) + 200 :]


def _guided(name: str, n: int, seed: int, folder: Path, place: Path) -> None:
    """Let atheris choose: inputs that reach new branches are spoilt further."""
    import atheris

    from fuzz.mutate import of_bytes

    # What numba compiles it must have seen before atheris traces it.
    root = Path(texclass.__file__).parent
    for file in sorted(root.rglob("*.py")):
        if "@njit" in file.read_text(encoding="utf-8"):
            importlib.import_module(".".join(("texclass", *file.relative_to(root).with_suffix("").parts)))
    with atheris.instrument_imports(include=list(GUIDED)):
        from fuzz.targets import target_of

        target_of(name)
    feeder = Feeder(name, folder, place)
    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)
    for i, data in enumerate(feeder.seeds):
        (corpus / f"seed{i}").write_bytes(data)

    def spoil(data: bytes, most: int, number: int) -> bytes:
        rng = random.Random(number)
        if rng.random() < 0.4:  # near a whole input there is more to read than far from all
            data = rng.choice(feeder.seeds)
        if rng.random() < 0.3:
            spoilt: bytes = atheris.Mutate(data, most)
            return spoilt
        try:
            return feeder.target.mutate(rng, data)[:most]
        except Exception:  # atheris waits for ever on a mutator that raises
            return of_bytes(rng, data)[:most]

    options: list[Any] = [
        sys.argv[0], f"-runs={n}", f"-seed={seed}", f"-max_len={MOST_BYTES}", "-rss_limit_mb=0",
        "-timeout=1000", "-verbosity=0", f"-artifact_prefix={folder}/", str(corpus),
    ]  # fmt: skip
    atheris.Setup(options, feeder.feed, custom_mutator=spoil)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
