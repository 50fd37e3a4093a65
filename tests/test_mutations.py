"""The tool that seeds faults: where they matter, one at a time, and what caught each."""

import ast

import pytest

from experiments.reliability import mutations
from experiments.reliability.faults import KINDS, faults, seeded

SOURCE = '''
"""A module: 1 + 1."""

def energy(mass: Float[Array, "2 3"], speed, floor=0.0):
    """0.5 * mass * speed**2."""
    if mass <= 0:
        raise ValueError(f"mass must be positive, not {mass + 1}")
    _check.positive(speed, "speed")
    kept = max(-floor, 0.5 * mass * speed**2 - floor, key=1e-9, strict=True)
    kept.sort(reverse=True)
    return np.sum(kept[1:], axis=0) + 64
'''

EXPECTED = {
    ("a comparison", 6, "mass <= 0 → mass >= 0"),
    ("an index", 6, "mass <= 1"),
    ("a skipped check", 7, "→ nothing"),
    ("a skipped check", 8, "→ nothing"),
    ("an exchanged function", 9, "min(-floor"),
    ("a sign", 9, "-floor → floor"),
    ("a coefficient", 9, "0.55 * mass"),
    ("a coefficient", 9, "speed ** 2.2"),
    ("times and divided", 9, "0.5 / mass"),
    ("times and divided", 9, "mass / speed"),
    ("plus and minus", 9, "speed ** 2 + floor"),
    ("a dropped term", 9, "speed ** 2 - floor → 0.5 * mass * speed ** 2"),
    ("a dropped statement", 10, "→ nothing"),
    ("a flag", 10, "reverse=False"),
    ("an index", 11, "2:"),
    ("an axis", 11, "axis=1"),
    ("plus and minus", 11, "axis=0) - 64"),
    ("a dropped term", 11, "return np.sum(kept[1:], axis=0)"),
}


def test_faults_are_seeded_where_they_matter():
    """By hand: all of them, and none in annotations, texts, tolerances, numbers of steps and ``strict``."""
    found = faults(SOURCE)
    for kind, line, words in EXPECTED:
        fitting = [fault for fault in found if fault.kind == kind and fault.line == line and words in fault.name]
        assert len(fitting) == 1, (kind, line, words, found)
    assert len(found) == len(EXPECTED)
    assert {kind for kind, _, _ in EXPECTED} == set(KINDS)
    assert len({fault.name for fault in found}) == len(found)


def test_a_fault_is_the_only_change():
    sound = ast.unparse(ast.parse(SOURCE)).splitlines()
    for fault in faults(SOURCE):
        changed = seeded(SOURCE, fault).splitlines()
        assert len(changed) == len(sound)
        assert sum(a != b for a, b in zip(changed, sound, strict=True)) == 1


@pytest.fixture
def records(tmp_path, monkeypatch):
    """A checkout of one function and one test, which does not see what becomes of ``b``; where its records go."""
    for folder in ("jshape", "tests"):
        (tmp_path / folder).mkdir()
    (tmp_path / "jshape" / "__init__.py").touch()
    (tmp_path / "jshape" / "mean.py").write_text("def mean(a, b):\n    return (a + b) / 2\n")
    (tmp_path / "tests" / "test_mean.py").write_text(
        "from jshape.mean import mean\n\n\ndef test_of_a():\n    assert mean(3.0, 0.0) == 1.5\n"
    )
    here = dict(ROOT=tmp_path, RECORD=tmp_path / "mutations.json", REASONS=tmp_path / "mutations.toml")
    what = dict(COPIED=("jshape", "tests"), ROOMS={"mean": "jshape/*.py"}, TESTS={"jshape": ("mean",)})
    for name, value in (here | what).items():
        monkeypatch.setattr(mutations, name, value)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    return tmp_path


def test_what_is_caught_and_what_survives(records, capsys):
    """By hand: of (a + b)/2 the test sees the 2 and the division, not the sign of b, and not whether it is there."""
    sound = (records / "jshape" / "mean.py").read_text()
    mutations.main(["--count", "9", "--seed", "1"])
    found = {result.name: result.caught for result in mutations.read().values()}
    survived = {"mean: (a + b) / 2 → (a - b) / 2", "mean: (a + b) / 2 → a / 2"}
    assert set(found) == {
        *survived,
        "mean: (a + b) / 2 → (a + b) / 2.2",
        "mean: return (a + b) / 2 → return (a + b) * 2",
    }
    assert {name for name, caught in found.items() if not caught} == survived
    assert {caught for caught in found.values() if caught} == {"tests/test_mean.py::test_of_a"}
    assert (records / "jshape" / "mean.py").read_text() == sound
    report = (records / "mutations.md").read_text()
    assert "| all | 4 | 2 | 0 | 50.0 % |" in report
    assert report.count("**survived**") == 2
    assert capsys.readouterr().out.count("SURVIVED") == 2

    # One is explained, the other is tried again: by a better test.
    (records / "mutations.toml").write_text("'jshape/mean.py: mean: (a + b) / 2 → a / 2' = 'b is 0'\n")
    with (records / "tests" / "test_mean.py").open("a") as file:
        file.write("\n\ndef test_of_b():\n    assert mean(0.0, 3.0) == 1.5\n")
    mutations.main(["--count", "9", "--seed", "1"])
    assert capsys.readouterr().out.count("test_of_b") == 1
    report = (records / "mutations.md").read_text()
    assert "| all | 4 | 3 | 1 | 100.0 % |" in report
    assert "| b is 0 |" in report


def test_a_test_that_fails_anyway_proves_nothing(records, capsys):
    (records / "tests" / "test_mean.py").write_text("def test_wrong():\n    assert False\n")
    mutations.main(["--count", "1"])
    assert "test_wrong fails without any fault" in capsys.readouterr().out
    assert mutations.read() == {}


def test_a_test_that_is_not_there_is_named(records):
    assert mutations.try_tests(records, ["tests/test_mean.py::test_b"]).caught == "tests/test_mean.py::test_b"


def test_what_does_not_end_is_caught(records):
    (records / "tests" / "test_mean.py").write_text("def test_endless():\n    while True: pass\n")
    assert mutations.try_tests(records, ["tests"], limit=1).caught == "the limit of 1 s"


def test_every_room_has_files_and_tests():
    drawn = mutations.draw(10**6, seed=0)
    assert {room for room, _, _ in drawn} == set(mutations.ROOMS)
    assert len({mutations.key(file, fault.name) for _, file, fault in drawn}) == len(drawn)
    for file in {file for _, file, _ in drawn}:
        assert all((mutations.ROOT / test.partition("::")[0]).exists() for test in mutations.tests_of(file))
    few = [room for room, _, _ in mutations.draw(16, seed=0)]
    assert all(few.count(room) == 2 for room in mutations.ROOMS)
