"""Files changed at random, checksums made right again: read, or refused by name; never a crash or a bomb."""

import os
import random

import pytest
from fuzz.contract import judge
from fuzz.targets import SHARES, target_of

DRAWN = int(os.environ.get("TEXCLASS_EXAMPLES", "120"))


@pytest.mark.parametrize("name", [*SHARES["exchange"], "scene", "path of a hand"])
def test_changed_files_are_read_or_refused_by_name(name, tmp_path):
    target = target_of(name)
    seeds = target.seeds()
    for number in range(DRAWN):
        rng = random.Random(number)
        verdict = judge(target, target.mutate(rng, rng.choice(seeds)), tmp_path)
        assert not verdict.broken, f"input {number}: {verdict}"
