import pytest

from texclass import shipped
from texclass.loaders import read_card


@pytest.mark.parametrize(
    "name", ["simulated", "simulated69", "biotac20", "taps5", "borealtc", "lmt_excerpts"]
)
def test_the_promised_cards_are_shipped(name):
    assert name in shipped.names("datasets")


@pytest.mark.parametrize("name", shipped.names("datasets"))
def test_every_shipped_card_is_valid_and_says_where_its_data_comes_from(name):
    card = read_card(name)
    assert card.name == name
    assert card.title
    assert card.source
    assert card.licence


def test_a_path_to_ones_own_definition_passes_through(tmp_path):
    own = tmp_path / "mine.toml"
    own.write_text("title = 'mine'")
    assert shipped.locate("datasets", own) == own
    assert shipped.read("datasets", str(own)) == {"title": "mine"}


def test_an_unknown_name_lists_the_shipped_ones():
    with pytest.raises(FileNotFoundError, match="simulated69"):
        shipped.locate("datasets", "nothing")


@pytest.mark.parametrize("name", ["../datasets/simulated", "./simulated"])
def test_a_shipped_name_is_a_name_not_a_path(name):
    with pytest.raises(FileNotFoundError):
        shipped.locate("datasets", name)


@pytest.mark.parametrize("content", [b"title = ", b"\xff\xfe"])
def test_a_file_that_is_not_toml_is_named(tmp_path, content):
    own = tmp_path / "broken.toml"
    own.write_bytes(content)
    with pytest.raises(ValueError, match=r"broken\.toml: not valid TOML"):
        shipped.read("datasets", own)
