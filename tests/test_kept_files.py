"""Files that jshape reads back, damaged in every way, and writes that fail."""

import errno
import json
import os

import numpy as np
import pytest

import jshape as js
from experiments.reliability.damage import damaged
from jshape import _files
from jshape._files import read_arrays, read_npz, read_text, whole, write_arrays
from jshape.export import read_shaper, read_tuned
from jshape.sweeps.checkpoint import in_chunks

KIND = "jshape-test 1"
ARRAYS = {"a": np.arange(40.0).reshape(8, 5), "b": np.array([1, 2, 3], np.int32), "none": np.zeros((0, 3))}


def same(found, expected):
    return set(found) == set(expected) and all(
        found[name].dtype == value.dtype and np.array_equal(found[name], value) for name, value in expected.items()
    )


def test_arrays_are_read_back_whole(tmp_path):
    path = tmp_path / "x.npz"
    write_arrays(path, KIND, {"for": "a test"}, ARRAYS)
    about, found = read_arrays(path, KIND)
    assert about == {"for": "a test"}
    assert same(found, ARRAYS)
    with pytest.raises(ValueError, match=r"x\.npz: cannot be read: its format is 'jshape-test 1', not 'jshape-test 2'"):
        read_arrays(path, "jshape-test 2")


def test_a_damaged_file_is_named_in_a_line_or_changes_nothing(tmp_path):
    path, random = tmp_path / "x.npz", np.random.default_rng(1)
    write_arrays(path, KIND, {}, ARRAYS)
    content, messages = path.read_bytes(), []
    for _ in range(300):
        path.write_bytes(damaged(content, random))
        try:
            _, found = read_arrays(path, KIND)
        except ValueError as error:
            messages.append(str(error))
        else:
            # A date in the archive, which nobody reads, and the like.
            assert same(found, ARRAYS)
    assert len(messages) > 200
    assert all(words.startswith(f"{path}: cannot be read: ") and "\n" not in words for words in messages)


def test_axes_of_results_whose_names_a_terminal_would_obey_are_refused(tmp_path):
    row = {"amplitudes": [1.0], "times": [0.0]}
    for name, words in {"x": None, "x\x1b[2J": "holds no results"}.items():
        _files.write_results(tmp_path, {"shapers": [{"name": "tuned", "shapers": {name: row}}]})
        if words is None:
            assert set(read_tuned(tmp_path)) == {"x"}
        else:
            with pytest.raises(ValueError, match=words):
                read_tuned(tmp_path)


@pytest.mark.parametrize("kind", ["shaper", "results"])
def test_a_damaged_shaper_is_no_other_shaper(tmp_path, kind):
    """Of a file, and of a folder of results: the very same numbers, or a line."""
    shaper = js.Shaper([0.25, 0.5, 0.25], [0.0, 0.61, 1.23])
    path, random, refused = tmp_path / f"{kind}.json", np.random.default_rng(3), 0
    if kind == "shaper":
        js.export(shaper, "json", path)
    else:
        row = {"name": "tuned", "amplitudes": [0.25, 0.5, 0.25], "times": [0.0, 0.61, 1.23]}
        _files.write_results(tmp_path, {"problem": "a", "shapers": [row]})
    content = path.read_bytes()

    def read() -> js.Shaper:
        found = read_shaper(path) if kind == "shaper" else read_tuned(tmp_path)
        assert isinstance(found, js.Shaper)
        return found

    for _ in range(80):
        path.write_bytes(damaged(content, random))
        try:
            found = read()
        except ValueError as error:
            refused += "\n" not in str(error)
        else:
            np.testing.assert_array_equal(
                np.stack([found.amplitudes, found.times]), [[0.25, 0.5, 0.25], [0, 0.61, 1.23]]
            )
    assert refused > 50
    # Whoever edits a file on purpose takes the digest out; how it is laid out does not matter.
    record = json.loads(content)
    path.write_text(json.dumps(record, sort_keys=True), encoding="utf-8")
    assert read().times[1] == 0.61
    part = record if kind == "shaper" else record["shapers"][0]
    part["times"][1] = 0.62
    path.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(ValueError, match="its digest is not that of its content"):
        read()
    del record["digest"]
    path.write_text(json.dumps(record), encoding="utf-8")
    assert read().times[1] == 0.62


def rewritten(path, **changes):
    """Write a file anew with other members, so that the archive's own check sums hold."""
    with np.load(path) as stored:
        members = dict(stored)
    np.savez(path, **(members | changes))


@pytest.mark.parametrize(
    "changes",
    [
        {"a": ARRAYS["a"] + 1},
        {"a": ARRAYS["a"].T},
        {"a": ARRAYS["a"].astype(np.float32)},
        {"more": np.zeros(3)},
        {"digest": np.asarray("0" * 64)},
        {"header": np.asarray("[" * 100_000)},
        {"header": np.asarray("null")},
        {"header": np.asarray(json.dumps({"format": KIND}))},
    ],
)
def test_the_digest_is_of_everything(tmp_path, changes):
    path = tmp_path / "x.npz"
    write_arrays(path, KIND, {}, ARRAYS)
    rewritten(path, **changes)
    with pytest.raises(ValueError, match=r"x\.npz: cannot be read: "):
        read_arrays(path, KIND)


def test_an_archive_that_unpacks_to_too_much_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(_files, "LARGEST", 10**6)
    np.savez_compressed(tmp_path / "bomb.npz", amplitudes=np.zeros(200_000), times=np.zeros(1))
    assert (tmp_path / "bomb.npz").stat().st_size < 10**4
    with pytest.raises(ValueError, match=r"bomb\.npz: .*it holds 1600264 bytes, more than 1000000"):
        read_shaper(tmp_path / "bomb.npz")


def test_an_archive_that_says_that_it_is_too_large_is_not_opened(tmp_path):
    # The size of the member that the archive's directory gives, 24 bytes after its mark: a byte more than a GiB.
    path = tmp_path / "x.npz"
    np.savez(path, amplitudes=np.zeros(1))
    content = bytearray(path.read_bytes())
    at = content.index(b"PK\x01\x02") + 24
    content[at : at + 4] = (2**30 + 1).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"x\.npz: cannot be read: it holds 1073741825 bytes, more than 1073741824"):
        read_npz(path)


def test_objects_are_neither_written_nor_read(tmp_path):
    """What NumPy pickles runs code when it is read."""
    path, objects = tmp_path / "x.npz", np.array([{}, []], object)
    with pytest.raises(ValueError, match="Object arrays cannot be saved"):
        write_arrays(path, KIND, {}, {"a": objects})
    assert not any(tmp_path.iterdir())
    np.savez(path, a=objects)
    with pytest.raises(ValueError, match=r"x\.npz: cannot be read: Object arrays cannot be loaded"):
        read_npz(path)


def shaper_record(**parts):
    record = {"format": "jshape-shaper", "version": 1, "amplitudes": [1.0], "times": [0.0]}
    return json.dumps(record | parts).encode()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.json", b"[" * 100_000, "recursion"),
        (
            "x.json",
            b'{"format": "jshape-shaper", "version": 1, "amplitudes": [1], "times": [1' + b"0" * 400 + b"]}",
            "not a shaper",
        ),
        (
            "x.json",
            b'{"format": "jshape-shaper", "version": 1, "amplitudes": [1], "times": [1' + b"0" * 5000 + b"]}",
            "not a shaper",
        ),
        ("x.json", b"3", "not a shaper"),
        ("x.json", shaper_record(version=True), "version True is not known"),
        ("x.json", shaper_record(amplitudes=[True]), "amplitudes must be numbers"),
        ("x.json", shaper_record(times=[False]), "times must be numbers"),
        ("x.csv", b"time_s,amplitude\n" + b"0,0\n" * 100_001, "amplitudes must be at most 100000, not 100001"),
        ("x.csv", b"time_s,amplitude\n0," + b"1" * 200_000 + b"\n", "field"),
        ("x.csv", b"time_s,amplitude\n0,1\n1e400,0\n", "finite"),
        ("x.csv", b"time_s,amplitude\n0," + b"[" * 10_000 + b"\n", "could not convert"),
        ("x.json", b" " * (2**24 + 1), "more than 16777216 bytes"),
        ("x.npz", b"", "not a shaper"),
        ("x.npz", b"\x93NUMPY\x01\x00", "not a shaper"),
    ],
)
def test_shaper_files_that_are_none_are_named_in_a_line(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=words) as caught:
        read_shaper(path)
    assert str(caught.value).startswith(f"{path}: not a shaper file: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_texts_in_an_npz_are_no_shaper(tmp_path):
    np.savez(tmp_path / "x.npz", amplitudes=np.array(["1.0"]), times=np.array([0.0]))
    with pytest.raises(ValueError, match=r"x\.npz: not a shaper file: amplitudes must be numbers"):
        read_shaper(tmp_path / "x.npz")


def test_a_shaper_file_with_a_byte_order_mark(tmp_path):
    path = tmp_path / "x.csv"
    path.write_bytes(b"\xef\xbb\xbftime_s,amplitude\n0,0.5\n1,0.5\n")
    assert read_shaper(path).times.tolist() == [0.0, 1.0]
    path.write_text("", encoding="utf-8")
    assert read_text(path) == ""


# --- checkpoints ------------------------------------------------------------------------------------------------------


RESULTS = {index: np.full((2, 3), float(index)) for index in range(3)}


def chunks(folder, computed, fingerprint=b"this"):
    def compute(missing):
        computed.extend(missing)
        return [(index, RESULTS[index]) for index in missing]

    return dict(in_chunks(compute, 3, folder, lambda: fingerprint, lambda index: RESULTS[index].shape))


def with_a_right_digest(**arrays):
    """A chunk of the same computation that holds these."""

    def write(folder):
        path = folder / "chunk_000001.npz"
        about, _ = read_arrays(path, "jshape-chunk 1")
        write_arrays(path, "jshape-chunk 1", about, arrays)

    return write


def of_another_computation(folder):
    chunks(folder.parent / "other", [], b"that")
    os.replace(folder.parent / "other" / "chunk_000001.npz", folder / "chunk_000001.npz")


SPOILT = {
    "of another chunk": lambda folder: (folder / "chunk_000001.npz").write_bytes(
        (folder / "chunk_000002.npz").read_bytes()
    ),
    "of another computation": of_another_computation,
    "of another shape": lambda folder: rewritten(folder / "chunk_000001.npz", result=np.zeros((1, 1))),
    "other numbers": lambda folder: rewritten(folder / "chunk_000001.npz", result=np.ones((2, 3)) + 1e-9),
    "of another shape, with a right digest": with_a_right_digest(result=np.zeros((2, 1))),
    "of texts, with a right digest": with_a_right_digest(result=np.full((2, 3), "1.0")),
    "without a result, with a right digest": with_a_right_digest(other=np.zeros((2, 3))),
    "truncated": lambda folder: os.truncate(folder / "chunk_000001.npz", 500),
    "empty": lambda folder: (folder / "chunk_000001.npz").write_bytes(b""),
    "random": lambda folder: (folder / "chunk_000001.npz").write_bytes(np.random.default_rng(0).bytes(900)),
    "a folder": lambda folder: ((folder / "chunk_000001.npz").unlink(), (folder / "chunk_000001.npz").mkdir()),
}


@pytest.mark.parametrize("case", SPOILT)
def test_a_spoilt_chunk_is_computed_again(tmp_path, case):
    folder = tmp_path / "store"
    chunks(folder, [])
    SPOILT[case](folder)
    computed = []
    if case == "a folder":
        # What stands in the way of the file is named.
        with pytest.raises(OSError, match=r"chunk_000001\.npz"):
            chunks(folder, computed)
        return
    found = chunks(folder, computed)
    assert computed == [1]
    assert same({str(i): value for i, value in found.items()}, {str(i): value for i, value in RESULTS.items()})
    chunks(folder, computed)
    assert computed == [1]


def test_damaged_chunks_change_no_result(tmp_path):
    folder, random = tmp_path / "store", np.random.default_rng(2)
    chunks(folder, [])
    path = folder / "chunk_000002.npz"
    content = path.read_bytes()
    for _ in range(200):
        path.write_bytes(damaged(content, random))
        assert all(np.array_equal(value, RESULTS[index]) for index, value in chunks(folder, []).items())


def test_a_store_whose_writing_was_cut_off_is_gone_on_with(tmp_path):
    folder = tmp_path / "store"
    folder.mkdir()
    (folder / ".1-1.partial").write_bytes(b"half")
    assert len(chunks(folder, [])) == 3
    (folder / "checkpoint.json").write_text("[" * 100_000, encoding="utf-8")
    with pytest.raises(ValueError, match="holds the chunks of another computation"):
        chunks(folder, [])


@pytest.mark.slow
def test_a_sweep_does_not_take_what_another_chunk_left(tmp_path, monkeypatch):
    # As a whole: one chunk's file copied over another's, which was accepted, and one of another shape, which was
    # broadcast into the result.
    monkeypatch.setattr("jshape.sweeps.chunks.CHUNK", 2)
    plant = js.plants.ModalPlant([4.0], [0.05])
    call = lambda: js.sweep(
        plant,
        js.Shaper([1.0], [0.0]),
        1.0,
        {"omega.0": [0.8, 0.9, 1.1, 1.2]},
        store=tmp_path / "s",
        estimate_error=False,
    )
    expected = call().residual_vibration.values
    (tmp_path / "s" / "chunk_000000.npz").write_bytes((tmp_path / "s" / "chunk_000001.npz").read_bytes())
    np.testing.assert_array_equal(call().residual_vibration.values, expected)
    np.save(tmp_path / "s" / "chunk_000001.npz", np.zeros((1, 1, 1)))
    np.testing.assert_array_equal(call().residual_vibration.values, expected)


# --- writing ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EFBIG, errno.EROFS, errno.EACCES])
@pytest.mark.parametrize("at", ["open", "replace"])
def test_a_write_that_fails_leaves_what_was_there(tmp_path, monkeypatch, code, at):
    path = tmp_path / "x.txt"
    path.write_text("before", encoding="utf-8")

    def fail(*_, **__):
        raise OSError(code, os.strerror(code), "another name")

    monkeypatch.setattr(_files.os if at == "replace" else _files.Path, at, fail)
    with pytest.raises(OSError, match=os.strerror(code)) as caught, whole(path) as file:
        file.write(b"after")
    assert caught.value.filename == str(path)
    monkeypatch.undo()
    assert [(p.name, p.read_text(encoding="utf-8")) for p in tmp_path.iterdir()] == [("x.txt", "before")]


def test_an_error_inside_is_no_error_of_writing(tmp_path):
    with pytest.raises(ZeroDivisionError), whole(tmp_path / "x"):
        raise ZeroDivisionError
    assert not any(tmp_path.iterdir())
