"""The sizes in docs/install.md are those of the installed packages."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")


def closure():
    """Return every distribution that texclass needs without extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names, waiting = {}, [Requirement(one).name for one in project["dependencies"]]
    while waiting:
        name = waiting.pop().lower().replace("_", "-")
        if name in names:
            continue
        try:
            names[name] = distribution(name)
        except PackageNotFoundError:
            continue
        wanted = map(Requirement, names[name].requires or ())
        waiting += [one.name for one in wanted if not one.marker or one.marker.evaluate({"extra": ""})]
    return names


def size_mb(package):
    """Return the size of the files of a distribution, in blocks of 4 kB as `du` counts them."""
    paths = (Path(file.locate()) for file in package.files or () if ".." not in file.parts)
    return sum(-(-path.stat().st_size // 4096) * 4096 for path in paths if path.is_file()) / 2**20


def test_the_page_states_the_sizes_of_the_largest_packages_and_of_all():
    sizes = {name: size_mb(package) for name, package in closure().items()}
    stated = {}
    for names, mb in re.findall(r"\n\| ([^|]+) \| (\d+) \|", PAGE):
        for name in names.lower().split(", "):
            stated[name.replace("-learn", "").strip()] = int(mb), names
    assert "pyarrow" not in sizes
    for name in sorted(sizes, key=sizes.get)[-8:]:  # the largest are in the table
        assert name.replace("scikit-learn", "scikit") in stated, name
    rows = {(mb, names) for mb, names in stated.values()}
    for mb, names in rows:
        if members := [sizes[n] for n in names.lower().split(", ") if n in sizes]:
            assert abs(sum(members) - mb) < 0.25 * mb, (names, members)
    total = int(re.search(r"about (\d+) MB", PAGE)[1])
    assert abs(sum(sizes.values()) + 35 - total) < 0.1 * total  # texclass and pip take 35 MB
