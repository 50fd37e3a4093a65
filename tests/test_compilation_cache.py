"""Programs kept from one process to the next: the same numbers, found again, and only where they may be."""

import errno
import hashlib
import json
import os
import subprocess
import sys
import time
import warnings
import zlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import two_mass

import jshape as js
from jshape import _compiling
from jshape import compilation_cache as programs
from jshape._jax_cache import seal
from jshape.compilation_cache import kept
from jshape.plants import TwoMass
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import final_state, initial
from jshape.sweeps.chunks import Chunk

runs: list[str] = []
"""What has been traced, in this process."""


class Lamp(eqx.Module):
    """Somebody else's code."""

    power: jax.Array


def both(x, factor: float, names: tuple[str, ...] = ()):
    runs.append("both")
    return {"pair": Chunk(jnp.sum(x), factor * x), "count": jnp.asarray(len(names))}


def lit(lamp: Lamp, x):
    runs.append("lit")
    return lamp.power * x


def energy(plant: TwoMass, times):
    """The whole way through the kernel, an eigenvalue decomposition (LAPACK) at its end."""
    runs.append("energy")
    plan = schedule(plant, 1.0, js.Shaper(jnp.full(3, 1 / 3), times))
    end, error = final_state(plant, plan, initial(plant), 32)
    return plant.residual_energy(end, plan.final_inputs(plant)), error, *jnp.linalg.eigh(jnp.outer(end, end))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of its own, and nothing traced so far."""
    runs.clear()
    monkeypatch.setattr(programs, "_folder", None)
    programs._open(tmp_path)
    (made,) = tmp_path.iterdir()
    return made


def same(found, expected) -> bool:
    equal = jax.tree.map(lambda a, b: bool(np.array_equal(a, b)), found, expected)
    return jax.tree.structure(found) == jax.tree.structure(expected) and all(jax.tree.leaves(equal))


def test_another_process_finds_the_program_and_the_same_numbers(folder):
    x = jnp.arange(3.0)
    first = kept(both)(x, 2.0)
    assert same(first, eqx.filter_jit(both)(x, 2.0))
    assert len(list(folder.iterdir())) == 1
    runs.clear()
    # A new wrapper knows as little as a new process.
    assert same(kept(both)(x, 2.0), first)
    assert runs == []


def test_the_kernel_and_lapack_go_through(folder):
    plant, times = two_mass(), jnp.array([0.0, 0.5, 1.1])
    kept(energy)(plant, times)
    runs.clear()
    found = kept(energy)(plant, times)
    assert runs == []
    assert same(found, jax.jit(energy)(plant, times))
    # What is traced is not part of the program: another plant runs through the same one.
    other = kept(energy)(eqx.tree_at(lambda p: p.m2, plant, jnp.array(1.3, plant.m2.dtype)), times)
    assert float(other[0]) != float(found[0])
    assert len(list(folder.iterdir())) == 1


def test_a_program_is_one_of_its_arguments(folder):
    function, x = kept(both), jnp.arange(3.0)
    function(x, 2.0)
    for args in [(jnp.arange(4.0), 2.0), (x.astype(jnp.float32), 2.0), (x, 3.0), (x, 2), (x, 2.0, ("a",))]:
        before = len(list(folder.iterdir()))
        assert same(function(*args), eqx.filter_jit(both)(*args))
        assert len(list(folder.iterdir())) == before + 1
    # So is a setting, for as long as it holds.
    for setting in (jax.enable_x64(False), jax.default_matmul_precision("float32")):
        with setting:
            before = len(list(folder.iterdir()))
            found = function(np.arange(3.0), 2.0)["pair"].size
            assert found.dtype == (jnp.float64 if jax.config.jax_enable_x64 else jnp.float32)
            assert len(list(folder.iterdir())) == before + 1


def test_code_that_is_not_ours_is_not_kept(folder):
    x = jnp.arange(3.0)
    assert np.array_equal(kept(lit)(Lamp(jnp.asarray(2.0)), x), 2 * x)
    assert np.array_equal(kept(both)(x, 2.0, (lambda: 0,))["pair"].size, 2 * x)
    assert list(folder.iterdir()) == []


def test_traced_arguments_are_traced_on(folder):
    total = lambda x: kept(both)(x, 3.0)["pair"].size.sum()
    assert np.array_equal(jax.grad(total)(jnp.arange(3.0)), np.full(3, 3.0))
    assert np.array_equal(jax.vmap(total)(jnp.ones((2, 3))), np.full(2, 9.0))
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("somewhere", [True, False])
def test_concrete_arguments_may_stand_in_another_program(somewhere, folder, monkeypatch):
    if not somewhere:
        monkeypatch.setattr(programs, "_folder", None)
    function, x = kept(both), jnp.arange(3.0)
    for scale in (jax.jit, jax.grad, jax.vmap, lambda f: f):
        total = lambda s: s * jnp.sum(function(x, 2.0)["pair"].size)
        given = jnp.ones(2) if scale is jax.vmap else 1.0
        assert np.all(scale(total)(given) == 6.0)


def test_a_damaged_file_is_written_anew(folder):
    x = jnp.arange(3.0)
    first = kept(both)(x, 2.0)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    version = whole.replace(programs._FORMAT.encode(), b"jshape-program 0")
    assert version != whole
    other = hashlib.sha256(version[32:]).digest() + version[32:]
    for damaged in (b"", whole[: len(whole) // 2], b"something else", other):
        path.write_bytes(damaged)
        assert same(kept(both)(x, 2.0), first)
        runs.clear()
        assert same(kept(both)(x, 2.0), first)
        assert runs == []


def test_a_flipped_bit_changes_no_number(folder):
    x = jnp.arange(3.0)
    expected = kept(both)(x, 2.0)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    for at in np.random.default_rng(0).choice(8 * len(whole), 1000, replace=False).tolist():
        damaged = bytearray(whole)
        damaged[at // 8] ^= 1 << at % 8
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match="damaged"):
            programs._read(path)
        if at % 100 == 0:
            assert same(kept(both)(x, 2.0), expected)
            # What was written anew is whole, and found by the next.
            runs.clear()
            assert same(kept(both)(x, 2.0), expected)
            assert runs == []
    path.write_bytes(whole)


def test_a_copy_of_another_program_changes_no_number(folder):
    """Whole, with a right digest, and for the same kind of arguments."""
    x = jnp.linspace(0.0, 1.0, 5)
    expected = [kept(both)(x, factor) for factor in (2.0, 3.0)]
    first, second = (file for file in folder.rglob("*both*"))
    contents = first.read_bytes(), second.read_bytes()
    second.write_bytes(contents[0])
    first.write_bytes(contents[1])
    assert all(same(kept(both)(x, factor), each) for factor, each in zip((2.0, 3.0), expected, strict=True))
    assert all(programs._read(path) for path in (first, second))  # Written anew.


def test_results_are_rebuilt_from_data():
    shaper = eqx.tree_at(lambda s: (s.amplitudes, s.times), js.Shaper([1.0], [0.0]), (4, 5))
    tree = {"parts": (1, [2, None], {"a": 3}), "shaper": shaper, "chunk": Chunk(6, 7)}
    rebuilt = programs._rebuild(json.loads(json.dumps(programs._describe(tree))))
    assert rebuilt == tree
    assert jax.tree.structure(rebuilt) == jax.tree.structure(tree)
    # No class of anybody else is looked up, and none that is no container.
    for name in (f"{__name__}:Lamp", "os:stat_result", "jshape.status:Status", "jshape.simulation.simulate:simulate"):
        with pytest.raises(programs._NotOursError):
            programs._rebuild([name, {}])


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no permissions to look at")
def test_a_folder_that_others_may_write_to_keeps_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_folder", None)
    programs._open(tmp_path / "programs")
    assert programs._folder is not None
    for part in (programs._folder, tmp_path / "programs"):
        assert part.stat().st_mode & 0o777 == 0o700
        part.chmod(0o777)
        with pytest.warns(UserWarning, match="others may write to it"):
            programs._open(tmp_path / "programs")
        assert programs._folder is None
        part.chmod(0o700)
        programs._open(tmp_path / "programs")


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no permissions to look at")
def test_what_jax_keeps_is_nobody_elses_either(tmp_path, monkeypatch):
    """What it has compiled is run as it lies there."""
    settled = jax.config.jax_compilation_cache_dir
    monkeypatch.setattr(programs, "_folder", None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    try:
        jax.config.update("jax_compilation_cache_dir", None)
        (tmp_path / "user" / "jshape").mkdir(parents=True)
        (tmp_path / "user" / "jshape").chmod(0o777)
        js.keep_programs()
        assert (tmp_path / "user" / "jshape").stat().st_mode & 0o777 == 0o755
        assert programs._folder is not None
        jax.config.update("jax_compilation_cache_dir", None)
        (tmp_path / "shared").mkdir()
        (tmp_path / "shared").chmod(0o777)
        with pytest.warns(UserWarning, match="others may write to it"):
            js.keep_programs(tmp_path / "shared")
        assert programs._folder is None
        assert jax.config.jax_compilation_cache_dir is None
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setattr(programs.Path, "home", fail_to_find)
        js.keep_programs()
        assert programs._folder is None
    finally:
        jax.config.update("jax_compilation_cache_dir", settled)


def test_jax_sees_damage_in_what_it_keeps(tmp_path, monkeypatch):
    """Judge: what it packed before, unpacked; zstd would not see most of the flips."""
    packing = pytest.importorskip("jax._src.compilation_cache")
    monkeypatch.setattr(programs, "_folder", None)
    monkeypatch.setattr(packing, "zstandard", WithoutChecksum, raising=False)
    settled = jax.config.jax_compilation_cache_dir
    try:
        js.keep_programs(tmp_path / "cache")
        whole = packing.compress_executable(bytes(np.random.default_rng(0).integers(0, 8, 20_000, dtype=np.uint8)))
        for at in np.random.default_rng(1).choice(8 * len(whole), 1000, replace=False).tolist():
            damaged = bytearray(whole)
            damaged[at // 8] ^= 1 << at % 8
            with pytest.raises(zlib.error):
                packing.decompress_executable(bytes(damaged))
    finally:
        jax.config.update("jax_compilation_cache_dir", settled)


class WithoutChecksum:
    """A package like zstandard that packs nothing and sees nothing."""

    class ZstdCompressor:
        def compress(self, data):
            return data

    class ZstdDecompressor:
        def decompress(self, data):
            return data


def fail_to_find():
    raise RuntimeError("Could not determine home directory.")


def test_errors_come_through(folder):
    with pytest.raises(TypeError, match="unsupported"):
        kept(both)(jnp.arange(3.0), None)
    with pytest.raises(ValueError, match="same length"):
        kept(energy)(two_mass(), jnp.ones((2, 2)))
    assert list(folder.iterdir()) == []


def test_other_code_or_settings_have_a_folder_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_folder", None)
    programs._open(tmp_path)
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=true")
    programs._open(tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    monkeypatch.delenv("XLA_FLAGS")
    monkeypatch.setattr(programs, "version", lambda name: "0")
    programs._open(tmp_path)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_process_compiles_lean_unless_its_user_says_otherwise(monkeypatch):
    monkeypatch.delenv("XLA_FLAGS")
    _compiling.compile_lean()
    lean = os.environ["XLA_FLAGS"]
    assert lean.split() == [f"--{name}={value}" for name, value in _compiling.WHOLE.items()]
    assert lean.startswith("--xla_cpu_use_fusion_emitters=false")
    for given in ("--xla_cpu_use_fusion_emitters=true", "--xla_cpu_enable_fast_math=false"):
        monkeypatch.setenv("XLA_FLAGS", given)
        _compiling.compile_lean()
        assert os.environ["XLA_FLAGS"].startswith(given)
        assert all(os.environ["XLA_FLAGS"].count(name) == 1 for name in _compiling.WHOLE)
    # An XLA that may not know the options is not given them.
    monkeypatch.setattr(_compiling, "WHOLE", {})
    monkeypatch.setenv("XLA_FLAGS", "")
    _compiling.compile_lean()
    assert os.environ["XLA_FLAGS"] == ""


MOVES = """
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import jshape as js
shaper = js.Shaper([0.3, 0.4, 0.3], [0.0, 0.35, 0.7])
pair = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))
left = lambda t: js.residual_energy(pair, js.Shaper(shaper.amplitudes, t), 1.0)
energy, slopes = jax.jit(jax.value_and_grad(left))(shaper.times)
crane = js.residual_energy(js.plants.DoublePendulumCrane(5.0, 1.5, 0.4, 2.0), shaper, js.Trapezoid(4.0, 1.0, 0.5))
print(*(float(x).hex() for x in [energy, *slopes, crane]))
"""


@pytest.mark.slow
def test_a_users_own_programs_give_the_same_numbers_as_lean_ones(monkeypatch):
    flags = ["", os.environ["XLA_FLAGS"]]
    monkeypatch.delenv("XLA_FLAGS")
    _compiling.compile_lean()
    flags.append(os.environ["XLA_FLAGS"])
    numbers = []
    for each in flags:
        environment = {**os.environ, "XLA_FLAGS": each}
        run = subprocess.run([sys.executable, "-c", MOVES], env=environment, capture_output=True, text=True, check=True)
        numbers.append([float.fromhex(x) for x in run.stdout.split()])
    assert len(numbers[0]) == 5
    np.testing.assert_allclose(numbers[1], numbers[0], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(numbers[2], numbers[0], rtol=1e-11, atol=1e-11)


def test_what_nobody_uses_any_more_is_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_folder", None)
    for name, days in (("old", 31), ("recent", 29)):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (time.time() - days * 86400,) * 2)
    programs._open(tmp_path)
    assert not (tmp_path / "old").exists()
    assert (tmp_path / "recent").exists()


def test_a_folder_that_cannot_be_written_to_keeps_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_folder", None)
    (tmp_path / "file").write_text("")
    programs._open(tmp_path / "file" / "programs")
    assert same(kept(both)(jnp.arange(3.0), 2.0), eqx.filter_jit(both)(jnp.arange(3.0), 2.0))


@pytest.mark.parametrize("what", ["put_executable_and_time", "get_executable_and_time"])
def test_a_disk_that_is_full_or_damaged_is_not_worth_a_word(what, tmp_path, monkeypatch):
    """JAX warns of each program that it cannot keep, and of each that it cannot read."""
    settled = jax.config.jax_compilation_cache_dir

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(programs, "_folder", None)
    monkeypatch.setattr(f"jax._src.compilation_cache.{what}", full)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            js.keep_programs(tmp_path)
            assert float(jax.jit(lambda x: 3 * x + len(what))(2.0)) == 6 + len(what)
    finally:
        jax.config.update("jax_compilation_cache_dir", settled)


def test_what_jax_keeps_is_whole_and_takes_the_place_of_what_is_damaged(tmp_path, monkeypatch):
    lru_cache = pytest.importorskip("jax._src.lru_cache")
    settled = jax.config.jax_compilation_cache_dir
    monkeypatch.setattr(programs, "_folder", None)
    try:
        for _ in range(2):
            js.keep_programs(tmp_path / "kept")
        cache = lru_cache.LRUCache(str(tmp_path / "entries"), max_size=-1)
        cache.put("name", b"a program")
        (entry,) = (tmp_path / "entries").iterdir()
        entry.write_bytes(b"a pro")
        cache.put("name", b"a program")
        assert cache.get("name") == b"a program"
        # A copy of another entry is none; JAX's own, written without jshape, are read.
        (tmp_path / "entries" / "copy-cache").write_bytes(entry.read_bytes())
        assert cache.get("copy") is None
        (tmp_path / "entries" / "copy-cache").write_bytes(b"a program by JAX alone")
        assert cache.get("copy") == b"a program by JAX alone"
        (tmp_path / "entries" / "copy-cache").unlink()
        monkeypatch.setattr("jshape._files.os.replace", full_disk)
        with pytest.raises(OSError, match="No space left"):
            cache.put("other", b"another program")
        assert [*(tmp_path / "entries").iterdir()] == [entry]
        packed = zlib.compress(b"a program")
        assert zlib.decompress(packed + seal("name", packed)) == b"a program"  # JAX without jshape.
    finally:
        jax.config.update("jax_compilation_cache_dir", settled)


def full_disk(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_where_programs_are_kept(tmp_path, monkeypatch):
    settled = jax.config.jax_compilation_cache_dir
    monkeypatch.setattr(programs, "_folder", None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "user"))
    try:
        jax.config.update("jax_compilation_cache_dir", None)
        js.keep_programs()
        assert programs._folder.parent == tmp_path / "user" / "jshape" / "programs"
        # What JAX was told, by a variable or in the script, holds.
        jax.config.update("jax_compilation_cache_dir", str(tmp_path / "jax"))
        js.keep_programs()
        assert programs._folder.parent == tmp_path / "jax" / "programs"
        js.keep_programs(tmp_path / "mine")
        assert programs._folder.parent == tmp_path / "mine" / "programs"
        assert jax.config.jax_compilation_cache_dir == str(tmp_path / "mine")
        for nowhere in ("", "gs://bucket"):
            programs._folder = None
            jax.config.update("jax_compilation_cache_dir", nowhere)
            js.keep_programs()
            assert programs._folder is None
    finally:
        jax.config.update("jax_compilation_cache_dir", settled)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no permissions to look at")
def test_folders_are_made_for_their_user_alone(tmp_path, monkeypatch):
    """Whatever the umask, and wherever JAX was told to keep its programs."""
    settled, before = jax.config.jax_compilation_cache_dir, os.umask(0)
    monkeypatch.setattr(programs, "_folder", None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    try:
        jax.config.update("jax_compilation_cache_dir", str(tmp_path / "told" / "deeper"))
        js.keep_programs()
        assert programs._folder is not None
        jax.config.update("jax_compilation_cache_dir", None)
        js.keep_programs()
        assert {part.stat().st_mode & 0o777 for part in tmp_path.rglob("*")} == {0o700}
        assert len([*tmp_path.rglob("*")]) == 8
    finally:
        os.umask(before)
        jax.config.update("jax_compilation_cache_dir", settled)


def test_a_thread_beside_gives_result_or_error():
    assert _compiling.beside(divmod, 7, 2).result() == (3, 1)
    with pytest.raises(ZeroDivisionError):
        _compiling.beside(divmod, 7, 0).result()


@pytest.mark.slow
def test_a_command_that_ends_does_not_wait_for_what_is_being_compiled():
    code = (
        "import sys, time; from jshape import cli; from jshape._compiling import beside; "
        "beside(time.sleep, 600); sys.argv = ['jshape', 'plants', 'Nothing']; cli.main()"
    )
    ended = subprocess.run([sys.executable, "-c", code], timeout=300, capture_output=True, text=True)
    assert ended.returncode == 2
    assert "Nothing" in ended.stderr


@pytest.mark.slow
def test_without_jax_s_private_name_everything_runs(tmp_path):
    """A JAX that no longer has it costs speed, not the answer."""
    code = """
import sys, types, jax, jax._src.core as core
jax.config.update("jax_enable_x64", True)
sys.modules[core.__name__] = without = types.ModuleType(core.__name__)
vars(without).update({name: value for name, value in vars(core).items() if name != "trace_state_clean"})
import jshape as js
from jshape.compilation_cache import trace_state_clean
sys.modules[core.__name__] = core
assert not trace_state_clean()
js.keep_programs(FOLDER)
print(float(js.residual_energy(js.plants.Crane(1.0), None, js.Trapezoid(1.0, 1.0, 1.0))))
"""
    code = code.replace("FOLDER", repr(str(tmp_path / "kept")))
    left = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert float(left) == pytest.approx(
        float(js.residual_energy(js.plants.Crane(1.0), None, js.Trapezoid(1.0, 1.0, 1.0))), rel=1e-12
    )
