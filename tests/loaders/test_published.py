"""Published recordings are downloaded file by file, checked, and converted to the layout of their card."""

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
    """Serves `files` on loopback, also as a proxy; interrupts the files in `interrupted`."""

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.files, self.interrupted, self.requests = {}, set(), []
        self.url = f"http://127.0.0.1:{self.server_address[1]}/"


class Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        name = self.path.rpartition("/shelf/")[2]
        self.server.requests.append(self.path)
        body = self.server.files[name]
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body[: len(body) // 2] if name in self.server.interrupted else body)

    def log_message(self, *_):
        pass


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr("pooch.core.time.sleep", lambda seconds: None)
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with Server() as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()  # polls every 0.01 s
        yield server
        server.shutdown()


@pytest.fixture
def shelf(server, tmp_path, monkeypatch):
    """Card of two files on the server, with the list of published files in the same folder."""
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    rng, checksums = np.random.default_rng(0), ""
    for name, local_name in {"oak/1.csv": "oak/1.csv", "tin plate.csv": "tin/2.csv"}.items():
        rows = "\n".join(f"{value:.3f}" for value in rng.standard_normal(500))
        server.files[name.replace(" ", "%20")] = content = f"x\n{rows}\n".encode()
        checksums += f"{hashlib.sha256(content).hexdigest()}\t{name}"
        checksums += f"\t{local_name}" * (local_name != name) + "\n"
        (tmp_path / "expected" / local_name).parent.mkdir(parents=True)
        (tmp_path / "expected" / local_name).write_bytes(content)
    total = digest_files(tmp_path / "expected", ("oak/1.csv", "tin/2.csv"), "")
    (tmp_path / "mine.sha256").write_text(checksums)
    download = f'[download]\nurl = "{server.url}shelf/"\nsha256 = "{total}"\n'
    (tmp_path / "mine.toml").write_text(CARD + download)
    return tmp_path / "mine.toml"


def test_licence_and_citation_are_printed_before_the_download(shelf, command):
    with pytest.raises(DataNotFoundError, match=r"Download them with `texclass datasets get .*mine.toml`"):
        open_dataset(shelf)
    code, out, _ = command("datasets", "get", shelf)
    assert code == 0
    assert out.index("licence: CC0") < out.index("cite: A. N. Other") < out.index("complete")
    assert [entry.recording_id for entry in open_dataset(shelf).entries] == ["oak/1", "tin/2"]


def test_an_interrupted_download_continues_with_the_missing_files(shelf, server, command):
    server.interrupted = {"tin%20plate.csv"}
    code, _, err = command("datasets", "get", shelf)
    assert (code, f"{server.url}shelf/tin plate.csv: cannot be downloaded" in err) == (1, True)
    with pytest.raises(DataNotFoundError):
        open_dataset(shelf)
    server.interrupted = set()
    server.requests.clear()
    assert command("datasets", "get", shelf)[0] == 0
    assert server.requests == ["/shelf/tin%20plate.csv"]


def test_a_file_that_differs_from_the_published_one_is_an_error(shelf, server, command):
    server.files["oak/1.csv"] = b"x\n1\n2\n"
    code, _, err = command("datasets", "get", shelf)
    assert (code, "SHA256" in err, "1.csv" in err) == (1, True, True)
    assert not list((shelf.parent / "data").rglob("*.csv"))


def test_a_complete_download_needs_no_network_and_a_changed_file_is_an_error(shelf, server, command):
    assert command("datasets", "get", shelf)[0] == 0
    server.requests.clear()
    assert command("datasets", "get", shelf)[0] == 0
    assert server.requests == []
    (shelf.parent / "data" / "plates" / "oak" / "1.csv").write_text("x\n1\n2\n")
    code, _, err = command("datasets", "get", shelf)
    assert (code, "plates: the SHA-256 of the 2 files is" in err) == (1, True)


def test_the_proxy_of_the_environment_is_used(shelf, server, command, monkeypatch):
    shelf.write_text(shelf.read_text().replace(server.url, "http://nowhere.invalid/"))
    monkeypatch.setenv("http_proxy", server.url)
    monkeypatch.setenv("no_proxy", "")
    assert command("datasets", "get", shelf)[0] == 0
    assert server.requests[0] == "http://nowhere.invalid/shelf/oak/1.csv"


def test_an_invalid_list_is_an_error_with_its_line(shelf, command):
    text, digest = shelf.with_suffix(".sha256").read_text(), "0" * 64
    for line in ("", "abc\toak.csv", f"{digest}\toak.csv\t../oak.csv", f"{digest}\t/oak.csv\toak.csv"):
        shelf.with_suffix(".sha256").write_text(f"{text}{line}\n")
        code, _, err = command("datasets", "get", shelf)
        assert (code, "mine.sha256: line 3 is" in err) == (1, True), line


def test_a_card_without_download_names_the_source_and_an_invalid_url_is_an_error(shelf, command):
    code, _, err = command("datasets", "get", "lmt69")
    assert (code, "no table [download]. Get them from https://zeus.lmt" in err) == (1, True)
    shelf.write_text(shelf.read_text().replace("http://", "ftp://"))
    with pytest.raises(CardError, match=r"download.url is 'ftp:.*. Expected an address that ends with /"):
        read_card(shelf)


def test_each_conversion_keeps_the_published_values(tmp_path):
    def convert_contents(convert, *contents):
        paths = [tmp_path / f"{i}" for i in range(len(contents))]
        for path, content in zip(paths, contents, strict=True):
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        return convert_files(paths, convert, 2200.0)

    frame = ",".join(map(str, range(45)))
    sound = convert_contents("frames", f"names\n{frame},\n{frame},\n")
    np.testing.assert_array_equal(np.frombuffer(sound[44:], "<i2"), [*range(4, 26), *range(4, 26)])
    assert np.frombuffer(sound[24:28], "<u4") == 2200
    assert convert_contents("rounded", "t,a\n0.01,-0.1234567\n") == b"t,a\n0.01,-0.12346\n"
    rows = [f"{i}.0000,1e20,3.0,4.0,5.0,6.0,0.0,0.0,0.0,{t}" for i, t in enumerate((0, 10, 20))]
    counts = convert_contents("counts", "\n".join(rows)).decode().split()
    assert counts == ["ax,ay,az,wx,wy,wz", *(f"{i},{10**20},3,4,5,6" for i in (0, 2))]
    books = []
    for value in (0.1, 0.2, 0.3):
        book = io.BytesIO()
        with zipfile.ZipFile(book, "w") as packed:
            packed.writestr("xl/worksheets/sheet1.xml", f'<c r="A1" t="n"><v>{value}</v></c>')
        books.append(book.getvalue())
    assert convert_contents("sheets", *books) == b"acceleration,normal_force,speed\n0.1,0.2,0.3\n"


def test_two_processes_that_fetch_at_once_both_end_with_the_whole_dataset(shelf, server):
    for _ in range(5):
        shutil.rmtree(shelf.parent / "data", ignore_errors=True)
        shutil.rmtree(shelf.parent / "cache", ignore_errors=True)
        with ThreadPoolExecutor(4) as pool:
            roots = [one.result() for one in [pool.submit(fetch_recordings, shelf) for _ in range(4)]]
        assert len(set(roots)) == 1
        assert [entry.recording_id for entry in open_dataset(shelf).entries] == ["oak/1", "tin/2"]
        assert [path.name for path in (shelf.parent / "data").iterdir()] == ["plates"]
