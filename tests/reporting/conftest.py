"""The page that several modules test."""

import pytest
from example_results import FILES

from texclass.cli.result_files import write_page


@pytest.fixture(scope="session")
def page_file(tmp_path_factory):
    """One page of a result of each kind."""
    return write_page(FILES, tmp_path_factory.mktemp("page") / "report.html")
