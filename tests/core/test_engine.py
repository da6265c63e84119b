import os
import subprocess
import sys

import pytest

TIME_LOOP = """
import seatrial
seatrial.configure()
import jax, jax.numpy as jnp
loop = jax.jit(lambda x: jax.lax.scan(lambda u, n: (u - 0.1 * u * abs(u) + n, None), x, jnp.arange(100.0))[0])
print("xla_cpu_small_call" in loop.lower(1.0).compile().as_text())
import os
print(os.environ["XLA_FLAGS"])
"""
OTHER_BACKEND_OPTION = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=0"
SETTINGS = ("XLA_FLAGS", "JAX_ENABLE_X64", "JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME")


def run_python(code: str, tmp_path, **environment: str) -> str:
    """Run code in a fresh interpreter without any setting but those given."""
    clean = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    defaults = {"JAX_PLATFORMS": "cpu", "XDG_CACHE_HOME": str(tmp_path)}
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**clean, **defaults, **environment},
    ).stdout.strip()


def warning_of(code: str, tmp_path, **environment: str) -> str:
    """Text of the one warning that code gives."""
    listen = (
        "import warnings; said = warnings.catch_warnings(record=True).__enter__(); warnings.simplefilter('always');"
    )
    (text,) = run_python(
        f"{listen} {code}; print(*(w.message for w in said), sep='\\n')", tmp_path, **environment
    ).splitlines()
    return text


@pytest.mark.parametrize(
    ("flags", "one_kernel"),
    [
        ("--xla_cpu_enable_fast_math=false", "True"),
        (OTHER_BACKEND_OPTION, "False"),
    ],
)
def test_a_time_loop_becomes_one_kernel_and_flags_of_the_user_are_kept(tmp_path, flags, one_kernel):
    found, after = run_python(TIME_LOOP, tmp_path, XLA_FLAGS=flags).splitlines()
    assert found == one_kernel
    assert after.startswith(flags)
    assert after.count("--xla_backend_extra_options") == 1


ONES = "import jax.numpy as jnp; print(jnp.ones(1).dtype)"
IMPORTS = ["import seatrial, jax", "import jax, jax.numpy as jnp; jnp.ones(1); import seatrial"]
LIGHT = "dir(seatrial), seatrial.make_record, seatrial.InputError, seatrial.CoefficientName"


@pytest.mark.parametrize("first", IMPORTS)
def test_importing_sets_nothing_that_a_program_of_its_own_feels_and_configure_does(tmp_path, first):
    """Nothing of JAX and of the environment that it reads changes before something that computes is used."""
    read = "{name: value for name, value in os.environ.items() if name.startswith(('JAX_', 'XLA_'))}"
    code = (
        f"import os; before = {read}; {first}; {LIGHT}; print({read} == before, jax.config.jax_compilation_cache_dir)"
    )
    code = f"{code}; {ONES}; seatrial.configure(); {ONES}"
    assert run_python(code, tmp_path).splitlines() == ["True None", "float32", "float64"]


@pytest.mark.parametrize(
    "use",
    ["seatrial.load_campaign", pytest.param("import seatrial.estimation.posterior.mode", marks=pytest.mark.proof)],
)
def test_what_computes_computes_in_double_precision(tmp_path, use):
    assert run_python(f"import jax, seatrial; {use}; {ONES}", tmp_path) == "float64"


@pytest.mark.proof
def test_switching_a_jax_that_was_there_is_said(tmp_path):
    said = warning_of("import jax, seatrial; seatrial.load_campaign", tmp_path)
    assert "has switched JAX to it" in said
    assert "seatrial.configure()" in said
    with pytest.raises(ValueError, match="expected 1, got 0"):
        warning_of("import jax, seatrial; seatrial.configure(); seatrial.load_campaign", tmp_path)
    with pytest.raises(ValueError, match="expected 1, got 0"):
        warning_of("import jax, seatrial; seatrial.load_campaign", tmp_path, JAX_ENABLE_X64="1")


def test_a_program_that_computes_in_single_precision_is_not_switched(tmp_path):
    code = """
import jax.numpy as jnp, seatrial, warnings
jnp.ones(1)
warnings.simplefilter("error")
for attempt in range(2):
    try:
        seatrial.load_campaign
    except seatrial.InputError as error:
        print(error.remedy, jnp.ones(1).dtype)
warnings.simplefilter("ignore")
seatrial.configure()
print(seatrial.load_campaign.__name__, jnp.ones(1).dtype)
"""
    *refused, after = run_python(code, tmp_path).splitlines()
    assert len(refused) == 2
    assert all(line.startswith("call seatrial.configure()") and line.endswith("float32") for line in refused)
    assert after == "load_campaign float64"


@pytest.mark.parametrize("use", [pytest.param("load_campaign", marks=pytest.mark.proof), "configure()"])
def test_single_precision_that_is_asked_for_is_warned_of(tmp_path, use):
    code = f"import jax, seatrial; seatrial.{use}; assert not jax.config.jax_enable_x64"
    assert "JAX_ENABLE_X64=0 sets single" in warning_of(code, tmp_path, JAX_ENABLE_X64="0")


def test_options_that_come_too_late_are_said(tmp_path):
    said = warning_of("import jax.numpy as jnp, seatrial; jnp.ones(1); seatrial.configure()", tmp_path)
    assert "simulations take 3 to 20 times longer" in said


COMPILED = "jax.config.update('jax_persistent_cache_min_compile_time_secs', 0.0); jax.jit(lambda x: x + 1)(1.0)"


@pytest.mark.parametrize(
    ("use", "kept"),
    [
        ("import seatrial, jax; seatrial.load_campaign", False),
        (f"{IMPORTS[1]}; seatrial.configure(cache=False)", False),
        pytest.param(f"{IMPORTS[0]}; seatrial.configure()", True, marks=pytest.mark.proof),
        (f"{IMPORTS[1]}; seatrial.configure()", True),
    ],
)
def test_compiled_code_is_kept_where_that_is_asked_for(tmp_path, use, kept):
    """By `configure` and so by every command, also where JAX has compiled something before; not by using seatrial."""
    assert run_python(f"{use}; {COMPILED}; {ONES}", tmp_path) == "float64"
    assert (tmp_path / "seatrial" / "xla").exists() == kept


def test_the_users_cache_is_kept(tmp_path):
    code = "import seatrial, jax; seatrial.configure(); print(jax.config.jax_compilation_cache_dir)"
    assert run_python(code, tmp_path, JAX_COMPILATION_CACHE_DIR=str(tmp_path / "own")) == str(tmp_path / "own")


def test_a_command_configures(tmp_path):
    code = "import sys; sys.argv = ['seatrial', '--version']; from seatrial.cli.main import main\ntry: main()\nexcept SystemExit: pass\n"
    told = run_python(
        f"{code}import os; print(os.environ['JAX_COMPILATION_CACHE_DIR'], os.environ['JAX_ENABLE_X64'])", tmp_path
    )
    assert told.splitlines()[-1] == f"{tmp_path / 'seatrial' / 'xla'} 1"
