import pytest

from texclass import shipped
from texclass.loaders import read_card


def test_every_shipped_card_is_valid_and_says_where_its_data_comes_from():
    promised = {"simulated", "simulated6", "simulated69", "biotac20", "taps5", "borealtc", "lmt_excerpts"}
    assert promised <= set(shipped.names("datasets"))
    for name in shipped.names("datasets"):
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


def test_a_shipped_name_is_a_name_not_a_path_and_an_unknown_one_lists_them():
    for name in ("nothing", "../datasets/simulated", "./simulated"):
        with pytest.raises(FileNotFoundError, match="simulated69"):
            shipped.locate("datasets", name)
