"""Files of results: what is written over, what is refused, and that nothing is half written."""

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
    assert json.loads((folder / "results.json").read_text()) == {"format": "jshape-results", "version": 1, "n": 7}
    _files.write_results(folder, {"rows": (1.5, [float("inf"), float("-inf")], {"x": float("nan")}), "title": "[/] µ"})
    text = (folder / "results.json").read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=pytest.fail) == {
        "format": "jshape-results",
        "version": 1,
        "rows": [1.5, ["diverged", "diverged"], {"x": None}],
        "title": "[/] µ",
    }
    assert text.endswith("}\n")
    assert [path.name for path in folder.iterdir()] == ["results.json"]


def test_what_may_be_written_to(tmp_path):
    _files.check_writable(tmp_path / "new")
    _files.check_writable(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="file: is a file, not a folder"):
        _files.check_writable(tmp_path / "file")
    with pytest.raises(ValueError, match="holds files that are not jshape's results"):
        _files.check_writable(tmp_path)


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
