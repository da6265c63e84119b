import importlib
import logging
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.compiled import engine, program_store, programs, tracing
from seatrial.compiled.program_store import NoKey, key_of
from seatrial.compiled.programs import counts
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import Normal, Uniform
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.simulate import _trajectory, simulate
from seatrial.vehicles.whole import whole_vehicle

TOY = """
import time
from dataclasses import dataclass
from functools import lru_cache
import jax, jax.numpy as jnp
from seatrial.compiled.programs import program
from seatrial.compiled.pytrees import compiled_tree

traced = []

@program
def volume(x, scale=2.0):
    traced.append("volume")
    root = jnp.linalg.cholesky(x @ x.T + jnp.eye(x.shape[0]))
    return {"log": scale * jnp.log(jnp.diag(root)).sum(), "root": root, "none": None}

@program(static_argnums=1, static_argnames="what")
def power(x, n, what="sum"):
    return getattr(jnp, what)(x) ** n

@program(donate_argnums=1)
def moved(by, x):
    return x + by

@program(static_argnums=0)
def called(function, x):
    return function(x)

@program
def slow(x):
    traced.append("slow")
    time.sleep(0.3)
    return x + 1.0

@lru_cache
def shifted(by):
    @program
    def shift(x):
        return x + by
    return shift

@compiled_tree("law")
@dataclass(frozen=True)
class Spring:
    stretch: object
    law: object

    @program
    def force(self, factor):
        return factor * self.stretch ** self.law.power

@dataclass(frozen=True)
class Law:
    power: int

    def __hash__(self):
        return 7

@program(static_argnums=0)
def by_law(law, x):
    return x ** law.power

def double(x):
    return 2.0 * x

def times(factor):
    return lambda x: factor * x
"""


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """A package whose programs are kept, in an empty cache."""
    (tmp_path / "toy").mkdir()
    (tmp_path / "toy" / "__init__.py").write_text(TOY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(engine, "BEGAN", time.time() + 1e6)
    monkeypatch.setattr(engine, "_keeps_programs", True)
    monkeypatch.setattr(program_store, "OWN_PACKAGES", (*program_store.OWN_PACKAGES, "toy"))
    monkeypatch.setattr(programs, "_is_writable", True)
    monkeypatch.setattr(programs, "_is_told", False)
    monkeypatch.setattr(programs, "_is_tried", False)
    program_store._sources.cache_clear()
    yield importlib.import_module("toy")
    del sys.modules["toy"]
    program_store._sources.cache_clear()


@pytest.fixture
def done():
    """Call for what was loaded and compiled since the last call."""
    before = [counts()]

    def since():
        now, last = counts(), before[0]
        before[0] = now
        return now.loaded - last.loaded, now.compiled - last.compiled

    return since


def files():
    return sorted(engine.program_directory().iterdir())


def test_a_program_gives_the_bits_of_jit_and_is_found_again(toy, done):
    x = np.random.default_rng(1).normal(size=(6, 6))
    expected = jax.jit(toy.volume.__wrapped__)(x)
    for outcome in ((0, 1), (0, 0)):
        found = toy.volume(x)
        assert found.keys() == expected.keys()
        assert found["none"] is None
        assert np.array_equal(found["root"], expected["root"])
        assert found["log"] == expected["log"]
        assert done() == outcome
    toy.volume.clear()
    assert toy.volume(x)["log"] == expected["log"]
    assert done() == (1, 0)


def test_arguments_of_another_kind_have_a_program_of_their_own(toy, done):
    x = np.eye(3)
    assert toy.volume(x)["log"].weak_type is False
    assert done() == (0, 1)
    assert toy.volume(jnp.asarray(x))["log"] == toy.volume(x)["log"]
    assert done() == (0, 0)  # of NumPy or JAX, the same
    for args in ((np.eye(4),), (x.astype(np.float32),), (x, 3.0)):
        toy.volume(*args)
    toy.volume(x, scale=3.0)
    assert done() == (0, 4)
    toy.volume(x, 5.0)
    toy.volume(x, np.float64(5.0))  # of a fixed kind, where a number of Python's takes that of the others
    assert done() == (0, 1)


def test_fixed_arguments_may_be_given_by_place_or_name(toy, done):
    x = jnp.array([1.0, 2.0])
    assert [float(toy.power(x, 2)), float(toy.power(x, n=2)), float(toy.power(x, 2, what="max"))] == [9.0, 9.0, 4.0]
    assert done() == (0, 3)
    assert toy.power(jnp.array([1, 2]), 2).dtype == int
    assert toy.power(jnp.array([1, 2]), 2.0).dtype == float  # 2 == 2.0
    assert done() == (0, 2)


def test_what_is_given_away_is_gone(toy, done):
    x = jnp.ones(3)
    assert np.array_equal(toy.moved(2.0, x), np.full(3, 3.0))
    assert x.is_deleted()
    toy.moved.clear()
    x = jnp.ones(3)
    assert np.array_equal(toy.moved(2.0, x), np.full(3, 3.0))
    assert x.is_deleted()
    assert done() == (1, 1)


def test_inside_another_function_it_is_part_of_that_one(toy, done):
    x = jnp.asarray(np.random.default_rng(2).normal(size=(3, 3)))
    plain = toy.volume.__wrapped__
    found = jax.grad(lambda x: toy.volume(x)["log"])(x)
    np.testing.assert_allclose(found, jax.grad(lambda x: plain(x)["log"])(x), rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(toy.volume)(x[None])["log"][0], plain(x)["log"], rtol=1e-12)
    np.testing.assert_allclose(
        jax.jit(lambda x: toy.volume(x)["log"] + toy.volume(np.eye(3))["log"])(x),
        plain(x)["log"] + plain(np.eye(3))["log"],
    )
    assert jax.eval_shape(toy.volume, x)["root"].shape == (3, 3)
    assert done() == (0, 0)


def test_keys_of_random_numbers_go_in_and_out(toy, done):
    fold = toy.called
    for _ in range(2):
        key = fold(jax.random.split, jax.random.key(3))
        assert np.array_equal(jax.random.key_data(key), jax.random.key_data(jax.random.split(jax.random.key(3))))
        fold.clear()
    assert done() == (1, 1)


def test_a_hash_that_all_share_mixes_nothing_up(toy, done):
    for power in (2, 3):
        law = toy.Law(power)
        assert hash(law) == 7
        assert float(toy.by_law(law, 3.0)) == 3.0**power
        assert float(toy.Spring(jnp.asarray(3.0), law).force(2.0)) == 2 * 3.0**power
    assert done() == (0, 4)
    assert len(files()) == 4


def test_a_function_inside_a_function_is_kept_with_what_it_holds(toy, done):
    assert [float(toy.shifted(by)(1.0)) for by in (2.0, 3.0)] == [3.0, 4.0]
    assert [float(toy.called(function, 5.0)) for function in (toy.double, toy.times(2.0), toy.times(3.0))] == [
        10.0,
        10.0,
        15.0,
    ]
    assert done() == (0, 5)
    toy.shifted.cache_clear()
    toy.called.clear()
    assert float(toy.shifted(3.0)(1.0)) == 4.0
    assert [float(toy.called(toy.times(factor), 5.0)) for factor in (3.0, 4.0)] == [15.0, 20.0]
    assert done() == (2, 1)


def own_density(values):
    return -(values["a"] ** 2)


@pytest.mark.parametrize("function", [lambda x: x + 1.0, partial(own_density)])
def test_a_function_of_the_users_own_is_not_kept(toy, done, function):
    argument = {"a": 2.0} if isinstance(function, partial) else 2.0
    assert float(toy.called(function, argument)) == float(function(argument))
    assert done() == (0, 0)
    assert not engine.program_directory().exists()


def test_nothing_is_kept_where_nobody_asked_for_it(toy, done, monkeypatch):
    monkeypatch.setattr(engine, "_keeps_programs", False)
    assert float(toy.volume(np.eye(2))["log"]) == pytest.approx(np.log(2) * 2)
    assert done() == (0, 0)
    assert not engine.program_directory().exists()


@pytest.mark.parametrize("module", ["jax._src.config", "jax._src.core"])
def test_a_release_of_jax_that_does_not_say_what_it_traces_keeps_nothing(toy, done, monkeypatch, caplog, module):
    try:
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, module, None)
            importlib.reload(tracing)
        assert [toy.power(jnp.arange(3.0), n) for n in (2, 3)] == [9.0, 27.0]
        np.testing.assert_allclose(jax.grad(lambda x: toy.volume(x)["log"])(jnp.eye(2)), jnp.eye(2))
        assert key_of(1)
    finally:
        importlib.reload(tracing)
    assert done() == (0, 0)
    assert not engine.program_directory().exists()
    cautions = [one.getMessage() for one in caplog.records if one.levelno == logging.WARNING]
    assert len(cautions) == 1
    assert "not kept with this release of JAX" in cautions[0]
    toy.power(jnp.arange(3.0), 2)
    assert done() == (0, 1)


def test_a_mesh_of_the_users_own_has_no_key():
    mesh = jax.sharding.AbstractMesh
    assert key_of(mesh((), ()))
    with pytest.raises(NoKey):
        key_of(mesh((2,), ("x",)))


def test_a_wrong_argument_is_refused_in_the_words_of_jax(toy):
    with pytest.raises(TypeError, match="abstract array"):
        toy.volume("x")
    with pytest.raises(ValueError, match=r"[hH]ashable"):
        toy.power(jnp.ones(2), [2])
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            toy.called(divided, 2.0)


def divided(x):
    return x / (1 // 0)


class TestThreads:
    def test_a_program_is_made_once(self, toy, done):
        found = []
        threads = [threading.Thread(target=lambda: found.append(float(toy.slow(1.0)))) for _ in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert found == [2.0] * 6
        assert done() == (0, 1)
        assert toy.traced.count("slow") == 1


def truncated(path):
    path.write_bytes(path.read_bytes()[:-20])


def flipped(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def emptied(path):
    path.write_bytes(b"")


def exchanged(path):
    (other,) = (one for one in files() if one != path)
    path.write_bytes(other.read_bytes())


def linked(path):
    path.rename(path.parent.parent / "elsewhere")
    path.symlink_to(path.parent.parent / "elsewhere")


def shared(path):
    path.chmod(0o606)


def shared_with_group(path):
    path.chmod(0o660)


def shared_folder(path):
    path.parent.chmod(0o707)


def folder_shared_with_group(path):
    path.parent.chmod(0o770)


def linked_folder(path):
    path.parent.rename(path.parent.parent / "elsewhere")
    path.parent.symlink_to(path.parent.parent / "elsewhere")


def replaced_by_folder(path):
    path.unlink()
    path.mkdir()


def without_machine_code(path):
    """What another version could have written under this key."""
    path.write_bytes(program_store._MAGIC + program_store._checksum(path.name, b"x") + b"x")


@pytest.mark.parametrize(
    "spoil",
    [
        truncated,
        flipped,
        emptied,
        exchanged,
        linked,
        shared,
        shared_with_group,
        shared_folder,
        folder_shared_with_group,
        linked_folder,
        replaced_by_folder,
        without_machine_code,
    ],
)
def test_a_file_that_cannot_be_trusted_is_not_read(toy, done, caplog, spoil):
    for n in (2, 3):
        toy.power(jnp.ones(2), n)
    path = next(one for one in files())
    toy.power.clear()
    done()
    spoil(path)
    with caplog.at_level(logging.WARNING, "seatrial"):
        assert [float(toy.power(jnp.ones(2), n)) for n in (2, 3)] == [4.0, 8.0]
    assert done() == ((0, 1) if "folder" in spoil.__name__ and spoil is not replaced_by_folder else (1, 1))
    (said,) = (record.message for record in caplog.records if record.name == "seatrial")
    assert said.startswith("caution: ")
    assert said.endswith("results are the same, and take longer")


@pytest.mark.parametrize("spoil", [truncated, flipped, exchanged, without_machine_code])
def test_a_damaged_file_is_written_anew(toy, done, spoil):
    for n in (2, 3):
        toy.power(jnp.ones(2), n)
    path = files()[0]
    spoil(path)
    for outcome in ((1, 3), (2, 0)):
        toy.power.clear()
        assert [float(toy.power(jnp.ones(2), n)) for n in (2, 3)] == [4.0, 8.0]
        assert done() == outcome


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), PermissionError(13, "Permission denied")])
def test_a_folder_that_takes_nothing_costs_time_only(toy, done, caplog, monkeypatch, error):
    def refuse(path):
        raise error

    monkeypatch.setattr(program_store, "atomic_path", refuse)
    with caplog.at_level(logging.WARNING, "seatrial"):
        assert [float(toy.power(jnp.ones(2), n)) for n in (2, 3, 4)] == [4.0, 8.0, 16.0]
    assert done() == (0, 1)  # the others are left to XLA and its cache
    assert [error.strerror in record.message for record in caplog.records if record.name == "seatrial"] == [True]
    assert files() == []


def test_a_processor_whose_code_is_refused_keeps_none(toy, done, caplog, monkeypatch):
    def refuse(*_, **__):
        raise RuntimeError("Machine type used for XLA:CPU compilation doesn't match")

    monkeypatch.setattr(programs.serialize_executable, "deserialize_and_load", refuse)
    with caplog.at_level(logging.WARNING, "seatrial"):
        assert [float(toy.power(jnp.ones(2), n)) for n in (2, 3)] == [4.0, 8.0]
    assert done() == (0, 1)
    assert ["doesn't match" in record.message for record in caplog.records if record.name == "seatrial"] == [True]
    assert not engine.program_directory().exists()


def test_the_folder_is_private(toy):
    toy.power(jnp.ones(2), 2)
    assert engine.program_directory().stat().st_mode & 0o777 == 0o700


def test_programs_unused_for_longest_make_room(toy, done, monkeypatch):
    for n in (2, 3):
        toy.power(jnp.ones(2), n)
    for path in files():
        os.utime(path, (1.0, 1.0))
    toy.power.clear()
    toy.power(jnp.ones(2), 2)  # a use
    monkeypatch.setattr(program_store, "MAX_STORE_BYTES", sum(path.stat().st_size for path in files()) + 10)
    monkeypatch.setattr(program_store, "_since_look", -1)
    toy.power(jnp.ones(2), 4)
    toy.power.clear()
    done()
    for n in (2, 4, 3):
        toy.power(jnp.ones(2), n)
    assert done() == (2, 1)


def test_nothing_is_kept_once_the_files_of_the_package_were_changed(toy, done, monkeypatch):
    monkeypatch.setattr(engine, "BEGAN", 0.0)
    assert float(toy.power(jnp.ones(2), 2)) == 4.0
    assert done() == (0, 0)
    assert not engine.program_directory().exists()


def surge(**constants):
    return whole_vehicle(Hull("AUV", 30.0, **constants), ("X_u", "X_uabsu", "T_nabsn"), moves=("u",))


def posterior(prior, name="a", likelihood=jnp.sum):
    return Posterior((Parameter(name, "1", name, prior),), likelihood, ())


DIFFERENT = {
    "kinds of number": (1, 1.0, True, np.float64(1.0), "1", b"1", 1 + 0j, (1,), [1], {1: 1}, None),
    "zeros": (0.0, -0.0),
    "order": ({"a": 1, "b": 2}, {"b": 2, "a": 1}, ("a", "b"), ("b", "a")),
    "nesting": (("a", ("b",)), (("a",), "b"), ("a", "b"), ("ab",)),
    "arrays": (np.zeros(2), np.zeros((2, 1)), np.zeros(2, int), np.ones(2), np.zeros(2, np.float32)),
    "priors": tuple(jax.tree.structure(posterior(prior)) for prior in (Normal(0.0, 1.0), Uniform(0.0, 1.0))),
    "names of parameters": tuple(jax.tree.structure(posterior(Normal(0.0, 1.0), name)) for name in "ab"),
    "vehicles": (
        surge(),
        surge(thrust_deduction=0.1),
        surge(fixed={"X_udot": -1.0}),
        surge(fixed={"X_udot": -2.0}),
        whole_vehicle(Hull("AUV", 31.0), ("X_u", "X_uabsu", "T_nabsn"), moves=("u",)),
        whole_vehicle(Hull("AUV", None), ("X_u", "X_uabsu", "T_nabsn"), moves=("u",)),
        whole_vehicle(Hull("AUV", 30.0), ("X_u", "T_nabsn"), moves=("u",)),
        whole_vehicle(Hull("AUV", 30.0), ("X_uabsu", "X_u", "T_nabsn"), moves=("u",)),
    ),
    "functions": (surge, partial(surge), partial(surge, x=1), jnp.sin, np.sin, max, jax.tree_util.Partial(surge)),
}


@pytest.mark.parametrize("kind", DIFFERENT)
def test_different_contents_have_different_keys(kind, monkeypatch):
    monkeypatch.setattr(program_store, "_VERSIONED_LIBRARIES", (*program_store._VERSIONED_LIBRARIES, "tests"))
    keys = [key_of(one) for one in DIFFERENT[kind]]
    assert len(set(keys)) == len(keys)
    assert keys == [key_of(one) for one in DIFFERENT[kind]]


def test_equal_contents_have_one_key():
    assert key_of(surge()) == key_of(surge()) == key_of(replace(surge(), name="another"))
    assert key_of(jax.tree.structure(posterior(Normal(0.0, 1.0)))) == key_of(
        jax.tree.structure(posterior(Normal(3.0, 2.0)))
    )


def test_a_law_of_the_users_own_has_no_key():
    with pytest.raises(NoKey):
        key_of(replace(surge(), derivative=lambda params, state, control: (0.0,)))


def slowed(model, factor):
    """Return a vehicle of the same names whose rates are smaller."""

    def derivative(params, state, control):
        return tuple(factor * rate for rate in model.derivative(params, state, control))

    return replace(model, derivative=derivative)


def test_two_vehicles_of_the_same_names_have_programs_of_their_own(toy, done, monkeypatch):
    monkeypatch.setattr(program_store, "_VERSIONED_LIBRARIES", (*program_store._VERSIONED_LIBRARIES, "tests"))
    params, control, step = {"X_u": -1.0, "X_uabsu": -2.0, "T_nabsn": 1e-3}, np.full((9, 1), 90.0), np.full(9, 0.1)
    for outcome in ((0, 3), (3, 0)):
        models = surge(), slowed(surge(), 0.5), slowed(surge(), 0.25)
        speeds = [simulate(model, params, control, step, [0.0])[1:, 0] for model in models]
        assert done() == outcome
        for i, mass in enumerate((30.0, 60.0, 120.0)):
            twin = whole_vehicle(Hull("twin", mass), ("X_u", "X_uabsu", "T_nabsn"), moves=("u",))
            np.testing.assert_allclose(speeds[i], simulate(twin, params, control, step, [0.0])[1:, 0], rtol=1e-12)
        _trajectory.cache_clear()
        done()


@pytest.mark.parametrize(
    "content", [own_density, object(), posterior(Normal(0.0, 1.0), likelihood=own_density), np.array([surge])]
)
def test_what_may_differ_in_another_process_has_no_key(content):
    with pytest.raises(NoKey):
        key_of(jax.tree.structure(content) if hasattr(content, "parameters") else content)


@pytest.mark.parametrize(
    "setting",
    [("jax_numpy_dtype_promotion", "strict"), ("jax_default_matmul_precision", "float32"), ("jax_enable_x64", False)],
)
def test_settings_of_jax_enter_the_key(setting):
    before, (name, value) = key_of(1), setting
    with getattr(jax, name.removeprefix("jax_"))(value):
        assert key_of(1) != before
    assert key_of(1) == before


def test_versions_and_processor_enter_the_key(monkeypatch):
    before = key_of(1)
    for name in ("_installed", "_processor"):
        with monkeypatch.context() as patch:
            patch.setattr(program_store, name, lambda: ("another",))
            program_store._machine.cache_clear()
            assert key_of(1) != before
        program_store._machine.cache_clear()
    assert key_of(1) == before


RUN = """
from seatrial.compiled import engine
from seatrial.compiled import program_store
from seatrial.compiled import programs
engine.configure()
program_store.OWN_PACKAGES += ("toy",)
import numpy as np, jax, toy
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle
found = toy.volume(np.random.default_rng(1).normal(size=(6, 6)))
assert toy.called(jax.tree_util.Partial(toy.times(3.0)), 1.0) == 3.0
vehicle = whole_vehicle(Hull("AUV", 30.0), ("X_u", "X_uabsu", "T_nabsn"), moves=("u",))
print(*programs.counts()[:2], float(found["log"]).hex(), np.asarray(found["root"]).tobytes().hex(), program_store.key_of(vehicle))
"""


@pytest.mark.proof
def test_another_process_finds_it_until_a_file_is_changed(tmp_path):
    """The seed of Python's hashes differs from process to process; the keys do not."""
    (tmp_path / "toy").mkdir()
    source = tmp_path / "toy" / "__init__.py"
    source.write_text(TOY)
    said = []
    for change in ("", "", "\nunused = 1\n"):
        source.write_text(source.read_text() + change)
        time.sleep(0.1)
        environment = {
            **os.environ,
            "XDG_CACHE_HOME": str(tmp_path / "cache"),
            "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path]),
        }
        run = subprocess.run([sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, check=True)
        said.append(run.stdout.split())
    first, second, third = said
    assert (first[:2], second[:2], third[:2]) == (["0", "2"], ["2", "0"], ["0", "2"])
    assert first[2:] == second[2:] == third[2:]


def test_it_is_told_once_that_compiling_takes_long(monkeypatch):
    said = []
    monkeypatch.setattr(engine, "_compiling", 0.0)
    engine.tell_of_compiling(said.append)
    for _ in range(4):
        engine.compiled_for(0.9)
    assert len(said) == 1
    assert "next run" in said[0]
