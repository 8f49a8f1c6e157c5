"""Fixtures that tests of several folders share."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run; `--hypothesis-profile=default` draws others.
settings.register_profile("same examples", derandomize=True, deadline=None)
settings.load_profile("same examples")
# As many workers as cores, each of one thread, and one process where all cores are asked for (`n_jobs=-1`):
# set before BLAS is loaded, inherited by what tests start.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LOKY_MAX_CPU_COUNT"):
    os.environ.setdefault(_name, "1")
# Compiled tests are kept: rewriting their assertions is half of what collecting them takes.
sys.dont_write_bytecode = False


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory):
    """Keep what tests remember out of the user's cache, in one that all workers of a run share."""
    place = tmp_path_factory.getbasetemp()
    place = place.parent if "PYTEST_XDIST_WORKER" in os.environ else place
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXCLASS_CACHE", str(place / "cache"))
        yield


@pytest.fixture
def data_root(monkeypatch):
    """Folder of real recordings, found by cards too; a test that asks for it skips where it is absent."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    root = Path(os.environ.get("TEXCLASS_DATA", beside))
    if not root.is_dir():
        pytest.skip(f"no real recordings at {root} (set TEXCLASS_DATA)")
    monkeypatch.setenv("TEXCLASS_DATA", str(root))
    return root


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Give a page of a browser with an empty profile; a test that asks for it `needs_chromium`."""
    from chromium import Browser

    shown = Browser(tmp_path_factory.mktemp("profile"))
    yield shown
    shown.close()


@pytest.fixture
def command(monkeypatch, capsys):
    """Run the command line; give exit code, standard output, standard error."""
    from texclass.cli import main

    # What is compiled depends on the tests before; `test_compilation` runs commands with empty caches.
    for module in (
        "texclass.cli.evaluation_commands",
        "texclass.cli.model_commands",
        "texclass.cli.score_command",
        "texclass.haptics.commands",
    ):
        monkeypatch.setattr(f"{module}.announce_start", lambda *subpackages: None)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["texclass", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
        return (code, *capsys.readouterr())

    return call


# Small models that are trained once.


@pytest.fixture(scope="session")
def kernel_model(_own_cache):
    from toy_surfaces import spectrum_model

    return spectrum_model("kernel")


@pytest.fixture(scope="session")
def linear_model(_own_cache):
    from toy_surfaces import spectrum_model

    return spectrum_model("lda")


@pytest.fixture(scope="session")
def window_model(_own_cache):
    from toy_surfaces import spectrum_model

    return spectrum_model("lda", window_s=0.25)


@pytest.fixture(scope="session")
def turning(_own_cache):
    from turning_surfaces import turning_model

    return turning_model()
