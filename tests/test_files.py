"""Files of results: what is written over, what is refused, and that nothing is half written."""

import errno
import json
import os
import threading

import pytest

from jshape import _files


def test_results_come_back_as_written(tmp_path):
    """In a folder that is made for them, and again over an earlier result; what JSON lacks has a word or nothing."""
    folder = tmp_path / "a" / "b"
    _files.write_results(folder, {"rows": (1.5, [float("inf"), float("-inf")], {"x": float("nan")}), "title": "[/] µ"})
    _files.check_writable(folder)
    _files.write_results(folder, {"n": 7})
    seven = json.loads((folder / "results.json").read_text())
    _files.check_seal(seven)
    assert len(seven.pop("digest")) == 64
    assert seven == {"format": "jshape-results", "version": 1, "n": 7}
    _files.write_results(folder, {"rows": (1.5, [float("inf"), float("-inf")], {"x": float("nan")}), "title": "[/] µ"})
    text = (folder / "results.json").read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=pytest.fail) == {
        "format": "jshape-results",
        "version": 1,
        "rows": [1.5, ["diverged", "diverged"], {"x": None}],
        "title": "[/] µ",
        "digest": json.loads(text)["digest"],
    }
    assert text.endswith("}\n")
    assert [path.name for path in folder.iterdir()] == ["results.json"]


def test_what_may_be_written_to(tmp_path):
    _files.check_writable(tmp_path / "new")
    _files.check_writable(tmp_path / "new" / "of new")
    _files.check_writable(tmp_path)
    assert not any(tmp_path.iterdir())
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="file: is a file, not a folder"):
        _files.check_writable(tmp_path / "file")
    with pytest.raises(ValueError, match="holds files that are not jshape's results"):
        _files.check_writable(tmp_path)


def test_files_beside_the_problem_stay_where_they_were_edited(tmp_path):
    """A plant's mesh, say: as written, with the content that is to be written, or not there, it is no edit."""
    mesh, written = tmp_path / "arm.stl", b"\xff as written"
    check = lambda content: _files.check_unedited(tmp_path, files={"arm.stl": content})
    _files.write_results(tmp_path, {"file_digests": {"arm.stl": _files.digest(written)}})
    check(b"new")
    mesh.write_bytes(written)
    check(b"new")
    mesh.write_bytes(b"edited")
    check(b"edited")
    _files.check_unedited(tmp_path)
    with pytest.raises(ValueError, match=r"arm\.stl: has been edited, and is left as it is"):
        check(b"new")
    # Without a record of what was written, or with one that says nothing, any other content is its user's.
    mesh.write_bytes(written)
    for digests in (None, [], {"other.stl": _files.digest(written)}):
        _files.write_results(tmp_path, {"file_digests": digests})
        check(written)
        with pytest.raises(ValueError, match="has been edited"):
            check(b"new")


def test_tables_have_their_head_and_one_ending_of_lines():
    rows = [[1, 2.5], ["a,b", 'say "c"']]
    assert _files.as_csv(["x", "y"], rows) == 'x,y\n1,2.5\n"a,b","say ""c"""\n'
    assert _files.as_csv(["x"], [], ending="\r\n") == "x\r\n"


def test_digests_are_those_of_sha256():
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert (_files.digest("abc"), _files.digest(b"abc")) == (known, known)


def test_names_and_texts_that_a_terminal_may_show():
    # A tab, a bell and a byte that is no UTF-8 are replaced, or written as escapes; spaces of any width stay.
    name = "a\tb\x07\udcff \u2003\u00a0\u00b5"
    assert _files.printable(name) == "a\ufffdb\ufffd\ufffd \u2003\u00a0\u00b5"
    assert _files.escaped(name) == "a\\tb\\x07\\udcff \u2003\u00a0\u00b5"


def test_a_file_of_just_the_greatest_size_is_read(tmp_path):
    path = tmp_path / "x.txt"
    path.write_bytes(b"12345678")
    assert _files.read_bytes(path, 8) == b"12345678"
    assert _files.read_text(path, 8) == "12345678"
    for read in (_files.read_bytes, _files.read_text):
        with pytest.raises(ValueError, match=r"x\.txt: cannot be read: it has more than 7 bytes"):
            read(path, 7)
    with pytest.raises(ValueError, match=r"y\.txt: cannot be read: No such file or directory"):
        _files.read_text(tmp_path / "y.txt")
    path.write_bytes(b"\xff")
    with pytest.raises(ValueError, match=r"x\.txt: cannot be read as text: .*0xff"):
        _files.read_text(path)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (EOFError(), "EOFError"),
        (OSError("no number"), "no number"),
        (OSError(errno.EIO, "Input/output error", "other"), "Input/output error"),
        (ValueError("two\n  lines"), "two lines"),
        (ValueError("x" * 300), "x" * 300),
        (ValueError("x" * 301), "x" * 300 + " ..."),
    ],
)
def test_what_any_error_says_is_one_line(error, words, tmp_path, monkeypatch):
    def fail(path):
        raise error

    monkeypatch.setattr(_files.zipfile, "ZipFile", fail)
    with pytest.raises(ValueError, match="cannot be read") as caught:
        _files.read_npz(tmp_path / "x.npz")
    assert str(caught.value) == f"{tmp_path / 'x.npz'}: cannot be read: {words}"


def test_a_full_disk_is_found_by_writing_to_it(tmp_path, monkeypatch):
    class Full:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def write(self, content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(_files.tempfile, "TemporaryFile", lambda dir: Full())
    with pytest.raises(ValueError, match="b: cannot be written to: No space left on device"):
        _files.check_writable(tmp_path / "a" / "b")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("content", ['{"format": "other"}', "{}", "[]", "{", '{"format": "jshape-results"'])
def test_results_of_other_programs_are_refused(content, tmp_path):
    (tmp_path / "results.json").write_text(content)
    with pytest.raises(ValueError, match="holds files that are not jshape's results"):
        _files.check_writable(tmp_path)


def test_a_file_is_there_when_it_is_complete(tmp_path):
    path = tmp_path / "x.bin"
    with _files.whole(path) as file:
        file.write(b"first")
        assert not path.exists()
    assert path.read_bytes() == b"first"
    with pytest.raises(TypeError), _files.whole(path) as file:
        file.writelines([b"half of the sec", None])
    assert path.read_bytes() == b"first"
    assert [found.name for found in tmp_path.iterdir()] == ["x.bin"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_stays_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    _files.write_text(tmp_path / "pipe", "through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert (tmp_path / "pipe").is_fifo()
    assert [found.name for found in tmp_path.iterdir()] == ["pipe"]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no links that anybody may make")
def test_a_link_in_the_place_of_what_is_being_written_is_not_followed(tmp_path):
    """In a folder where others may write, too, one of them may have guessed the name."""
    (tmp_path / "mine").write_text("mine")
    (tmp_path / f".{os.getpid()}-{threading.get_ident()}.partial").symlink_to(tmp_path / "mine")
    _files.write_text(tmp_path / "x", "other")
    assert (tmp_path / "mine").read_text() == "mine"
    assert (tmp_path / "x").read_text() == "other"
    assert not (tmp_path / "x").is_symlink()
