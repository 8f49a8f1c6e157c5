"""The container image: versions, copied files, user and the command that the documentation shows."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
INSTRUCTIONS = [
    line.split(maxsplit=1)
    for line in re.sub(r"\\\n\s*", "", (ROOT / "Dockerfile").read_text(encoding="utf-8")).splitlines()
    if line and not line.startswith("#")
]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LINES = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
PINS = {
    canonicalize_name(name): version
    for name, version in (line.split("==") for line in LINES if line and not line.startswith("#"))
}


def of(kind):
    return [rest for name, rest in INSTRUCTIONS if name == kind]


def test_every_requirement_is_pinned_to_a_version_that_it_allows():
    for text in (*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"]):
        requirement = Requirement(text)
        assert PINS[canonicalize_name(requirement.name)] in requirement.specifier, text


def test_all_stages_have_one_base_image_with_a_full_version():
    (image,) = {rest.split()[0] for rest in of("FROM")}
    assert re.fullmatch(r"python:\d+\.\d+\.\d+-slim-\w+(@sha256:[0-9a-f]{64})?", image)
    assert f"Programming Language :: Python :: {image[7:11]}" in PROJECT["project"]["classifiers"]
    assert f"for Python {image[7:11]}." in LINES[0]


def test_whatever_the_wheel_contains_is_copied_and_not_ignored():
    copied = {source for rest in of("COPY") if "--from" not in rest for source in rest.split()[:-1]}
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    files = {PROJECT["project"]["readme"], *PROJECT["project"]["license-files"]}
    assert copied >= {
        *wheel["packages"],
        *wheel["force-include"],
        *files,
        "pyproject.toml",
        "constraints.txt",
    }
    allowed = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    assert allowed == copied
    assert all((ROOT / source).exists() for source in copied)


def test_the_program_is_the_command_line_and_its_user_is_not_root():
    assert of("ENTRYPOINT") == ['["texclass"]']
    assert "texclass" in PROJECT["project"]["scripts"]
    (user,) = of("USER")
    assert int(user) > 0
    assert f"--uid {user} " in " ".join(of("RUN"))
    assert INSTRUCTIONS.index(["USER", user]) > max(
        i for i, (name, _) in enumerate(INSTRUCTIONS) if name == "RUN"
    )
    caches = " ".join(of("ENV"))
    for name in ("TEXCLASS_CACHE", "NUMBA_CACHE_DIR", "MPLCONFIGDIR", "HOME"):
        assert f"{name}=/cache" in caches


@pytest.mark.parametrize("page", ["README.md", "docs/install.md"])
def test_commands_of_the_documentation_run_the_image_in_its_folder(page):
    from texclass.cli.app import app

    text = (ROOT / page).read_text(encoding="utf-8").replace("\\\n", " ")
    commands = [shlex.split(line) for line in text.splitlines() if "docker run " in line]
    assert commands
    assert "docker build -t texclass ." in text
    names = {
        command.name or command.callback.__name__.replace("_", "-") for command in app.registered_commands
    }
    for words in commands:
        volumes = [words[i + 1] for i, word in enumerate(words) if word == "-v"]
        assert any(volume.endswith(f":{of('WORKDIR')[-1]}") for volume in volumes)
        assert words[words.index("texclass") + 1] in names
