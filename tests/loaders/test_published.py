"""Public recordings are fetched file by file, checked, and brought into the layout of their card."""

import hashlib
import io
import shutil
import threading
import zipfile
from concurrent.futures import ThreadPoolExecutor
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

from texclass.loaders import CardError, DataNotFoundError, open_dataset, read_card
from texclass.loaders.places import convert_files, digest_files, fetch_recordings

CARD = """
title = "Two plates"
source = "somebody's shelf"
licence = "CC0"
citation = "A. N. Other, Plates, 2015"
format = "files"
folder = "plates"
fs_hz = 1000
unit = "g"
files = '(?P<surface>\\w+)/\\d\\.csv'
phases = "movement"
"""


class Server(ThreadingHTTPServer):
    """Serves `files` on loopback, also as a proxy; breaks off in the middle of those that `breaks` names."""

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.files, self.breaks, self.asked = {}, set(), []
        self.url = f"http://127.0.0.1:{self.server_address[1]}/"


class Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        name = self.path.rpartition("/shelf/")[2]
        self.server.asked.append(self.path)
        body = self.server.files[name]
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body[: len(body) // 2] if name in self.server.breaks else body)

    def log_message(self, *_):
        pass


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr("pooch.core.time.sleep", lambda seconds: None)
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with Server() as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()  # s between looks
        yield server
        server.shutdown()


@pytest.fixture
def shelf(server, tmp_path, monkeypatch):
    """Two files, served; the card that says so, and the list of files (published -> here) beside it."""
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    rng, listed = np.random.default_rng(0), ""
    for name, here in {"oak/1.csv": "oak/1.csv", "tin plate.csv": "tin/2.csv"}.items():
        rows = "\n".join(f"{value:.3f}" for value in rng.standard_normal(500))
        server.files[name.replace(" ", "%20")] = content = f"x\n{rows}\n".encode()
        listed += f"{hashlib.sha256(content).hexdigest()}\t{name}" + f"\t{here}" * (here != name) + "\n"
        (tmp_path / "expected" / here).parent.mkdir(parents=True)
        (tmp_path / "expected" / here).write_bytes(content)
    total = digest_files(tmp_path / "expected", ("oak/1.csv", "tin/2.csv"), "")
    (tmp_path / "mine.sha256").write_text(listed)
    published = f'[published]\nurl = "{server.url}shelf/"\nsha256 = "{total}"\n'
    (tmp_path / "mine.toml").write_text(CARD + published)
    return tmp_path / "mine.toml"


def test_what_is_fetched_is_read_after_licence_and_citation_were_said(shelf, command):
    with pytest.raises(DataNotFoundError, match=r"`texclass datasets get .*mine.toml` fetches them"):
        open_dataset(shelf)
    code, out, _ = command("datasets", "get", shelf)
    assert code == 0
    assert out.index("licence: CC0") < out.index("cite: A. N. Other") < out.index("complete")
    assert [entry.recording_id for entry in open_dataset(shelf).entries] == ["oak/1", "tin/2"]


def test_what_broke_off_goes_on_with_the_files_that_lack(shelf, server, command):
    server.breaks = {"tin%20plate.csv"}
    code, _, said = command("datasets", "get", shelf)
    assert (code, f"{server.url}shelf/tin plate.csv: cannot be fetched" in said) == (1, True)
    with pytest.raises(DataNotFoundError):  # half of them are no dataset
        open_dataset(shelf)
    server.breaks = set()
    server.asked.clear()
    assert command("datasets", "get", shelf)[0] == 0
    assert server.asked == ["/shelf/tin%20plate.csv"]


def test_another_file_than_the_published_one_is_refused_and_named(shelf, server, command):
    server.files["oak/1.csv"] = b"x\n1\n2\n"
    code, _, said = command("datasets", "get", shelf)
    assert (code, "SHA256" in said, "1.csv" in said) == (1, True, True)
    assert not list((shelf.parent / "data").rglob("*.csv"))


def test_what_is_complete_needs_no_network_and_a_file_that_was_changed_here_is_told(shelf, server, command):
    assert command("datasets", "get", shelf)[0] == 0
    server.asked.clear()
    assert command("datasets", "get", shelf)[0] == 0
    assert server.asked == []
    (shelf.parent / "data" / "plates" / "oak" / "1.csv").write_text("x\n1\n2\n")
    code, _, said = command("datasets", "get", shelf)
    assert (code, "plates: the SHA-256 over 2 files is" in said) == (1, True)


def test_a_proxy_of_the_environment_is_asked(shelf, server, command, monkeypatch):
    shelf.write_text(shelf.read_text().replace(server.url, "http://nowhere.invalid/"))
    monkeypatch.setenv("http_proxy", server.url)
    monkeypatch.setenv("no_proxy", "")
    assert command("datasets", "get", shelf)[0] == 0
    assert server.asked[0] == "http://nowhere.invalid/shelf/oak/1.csv"


def test_a_list_that_breaks_the_rule_is_told_by_its_line(shelf, command):
    whole, digest = shelf.with_suffix(".sha256").read_text(), "0" * 64
    for line in ("", "abc\toak.csv", f"{digest}\toak.csv\t../oak.csv", f"{digest}\t/oak.csv\toak.csv"):
        shelf.with_suffix(".sha256").write_text(f"{whole}{line}\n")
        code, _, said = command("datasets", "get", shelf)
        assert (code, "mine.sha256: line 3 is" in said) == (1, True), line


def test_a_card_published_nowhere_says_where_to_ask_and_an_address_that_is_none_is_refused(shelf, command):
    code, _, said = command("datasets", "get", "lmt69")
    assert (code, "no [published]; they are at https://zeus.lmt" in said) == (1, True)
    shelf.write_text(shelf.read_text().replace("http://", "ftp://"))
    with pytest.raises(CardError, match=r"published.url is 'ftp:.*. Expected an address that ends in /"):
        read_card(shelf)


def test_each_conversion_keeps_the_published_values(tmp_path):
    def made(convert, *contents):
        paths = [tmp_path / f"{i}" for i in range(len(contents))]
        for path, content in zip(paths, contents, strict=True):
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        return convert_files(paths, convert, 2200.0)

    frame = ",".join(map(str, range(45)))
    sound = made("frames", f"names\n{frame},\n{frame},\n")
    np.testing.assert_array_equal(np.frombuffer(sound[44:], "<i2"), [*range(4, 26), *range(4, 26)])
    assert np.frombuffer(sound[24:28], "<u4") == 2200
    assert made("rounded", "t,a\n0.01,-0.1234567\n") == b"t,a\n0.01,-0.12346\n"
    rows = [f"{i}.0000,1e20,3.0,4.0,5.0,6.0,0.0,0.0,0.0,{t}" for i, t in enumerate((0, 10, 20))]
    counts = made("counts", "\n".join(rows)).decode().split()
    assert counts == ["ax,ay,az,wx,wy,wz", *(f"{i},{10**20},3,4,5,6" for i in (0, 2))]
    books = []
    for value in (0.1, 0.2, 0.3):
        book = io.BytesIO()
        with zipfile.ZipFile(book, "w") as packed:
            packed.writestr("xl/worksheets/sheet1.xml", f'<c r="A1" t="n"><v>{value}</v></c>')
        books.append(book.getvalue())
    assert made("sheets", *books) == b"acceleration,normal_force,speed\n0.1,0.2,0.3\n"


def test_two_processes_that_fetch_at_once_both_end_with_the_whole_dataset(shelf, server):
    for _ in range(5):
        shutil.rmtree(shelf.parent / "data", ignore_errors=True)
        shutil.rmtree(shelf.parent / "cache", ignore_errors=True)
        with ThreadPoolExecutor(4) as pool:
            roots = [one.result() for one in [pool.submit(fetch_recordings, shelf) for _ in range(4)]]
        assert len(set(roots)) == 1
        assert [entry.recording_id for entry in open_dataset(shelf).entries] == ["oak/1", "tin/2"]
        assert [path.name for path in (shelf.parent / "data").iterdir()] == ["plates"]
