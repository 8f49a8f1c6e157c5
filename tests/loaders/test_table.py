import pandas as pd
import pytest

from texclass.loaders import load_recording
from texclass.recording import RecordingError


def load(path, **options):
    return load_recording(
        path, **{"fs": 1000, "unit": "counts", "column": "a"} | options
    ).acceleration.tolist()


def test_a_stated_delimiter_is_used(tmp_path):
    (tmp_path / "r.csv").write_text("a;b\n1;2\n3;4\n")
    assert load(tmp_path / "r.csv", delimiter=";") == [1, 3]


def test_a_wrong_delimiter_is_suspected(tmp_path):
    (tmp_path / "r.csv").write_text("a;b\n1;2\n3;4\n")
    with pytest.raises(
        RecordingError, match=r"column 'a' occurs 0 times; its columns are 'a;b'.*is ',' the delimiter"
    ):
        load(tmp_path / "r.csv")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a,b\n1,2\nx,4\n", "Row #3.*'x'.*a number in every cell"),
        ("a,b\n1,2\n,4\n", "Row #3.*a number in every cell"),
        ("a,b\n1,2\n3\n", "Row #3: Expected 2 columns, got 1"),
        ("a,a\n1,2\n", "column 'a' occurs 2 times"),
        ("b,c\n1,2\n", "column 'a' occurs 0 times"),
        ("a,b\n", "acceleration is empty"),
        ("a,b\n1,2\nNA,4\n", "Row #3"),
    ],
)
def test_a_bad_table_is_refused_with_its_line(tmp_path, content, message):
    (tmp_path / "r.csv").write_text(content)
    with pytest.raises(RecordingError, match=f"(?s)r.csv: .*{message}"):
        load(tmp_path / "r.csv")


def test_columns_that_are_not_asked_for_may_hold_text(tmp_path):
    (tmp_path / "r.csv").write_text("note, a\nfirst,1\nsecond,2\n")
    assert load(tmp_path / "r.csv") == [1, 2]


def test_bytes_that_are_not_text_are_refused(tmp_path):
    (tmp_path / "r.csv").write_bytes(b"\xff\xfe\x00a")
    with pytest.raises(RecordingError, match="line 1 is not a header"):
        load(tmp_path / "r.csv")


def test_a_parquet_column_of_text_is_refused(tmp_path):
    pd.DataFrame({"a": ["1", "2"]}).to_parquet(tmp_path / "r.parquet")
    with pytest.raises(RecordingError, match="a holds object; the rule is real numbers"):
        load(tmp_path / "r.parquet")


def test_a_gap_in_a_parquet_column_is_refused(tmp_path):
    pd.DataFrame({"a": pd.array([1, None, 3], dtype="Int64")}).to_parquet(tmp_path / "r.parquet")
    with pytest.raises(RecordingError, match="a lacks 1 values"):
        load(tmp_path / "r.parquet")
