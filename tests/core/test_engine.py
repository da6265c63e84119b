import os
import subprocess
import sys

import pytest

TIME_LOOP = """
import seatrial, jax, jax.numpy as jnp
loop = jax.jit(lambda x: jax.lax.scan(lambda u, n: (u - 0.1 * u * abs(u) + n, None), x, jnp.arange(100.0))[0])
print("xla_cpu_small_call" in loop.lower(1.0).compile().as_text())
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


@pytest.mark.parametrize(
    ("flags", "one_kernel"),
    [
        ("", "True"),
        ("--xla_cpu_enable_fast_math=false", "True"),
        (OTHER_BACKEND_OPTION, "False"),
    ],
)
def test_a_time_loop_becomes_one_kernel(tmp_path, flags, one_kernel):
    assert run_python(TIME_LOOP, tmp_path, XLA_FLAGS=flags) == one_kernel


@pytest.mark.parametrize("flags", ["--xla_cpu_enable_fast_math=false", OTHER_BACKEND_OPTION])
def test_flags_of_the_user_are_kept(tmp_path, flags):
    after = run_python("import seatrial, os; print(os.environ['XLA_FLAGS'])", tmp_path, XLA_FLAGS=flags)
    assert after.startswith(flags)
    assert after.count("--xla_backend_extra_options") == 1


DTYPE = "import jax.numpy as jnp; print(jnp.ones(1).dtype)"


@pytest.mark.parametrize(
    ("code", "environment", "dtype"),
    [
        (f"import seatrial; {DTYPE}", {}, "float64"),
        (f"import jax, seatrial; {DTYPE}", {}, "float64"),
        (f"import seatrial; {DTYPE}", {"JAX_ENABLE_X64": "0"}, "float32"),
        (f"import jax, seatrial; {DTYPE}", {"JAX_ENABLE_X64": "0"}, "float32"),
    ],
)
def test_double_precision_unless_the_user_says_otherwise(tmp_path, code, environment, dtype):
    assert run_python(code, tmp_path, **environment) == dtype


@pytest.mark.parametrize("first", ["seatrial", "jax"])
def test_compiled_kernels_are_cached(tmp_path, first):
    code = f"import {first}, seatrial, jax; print(jax.config.jax_compilation_cache_dir)"
    assert run_python(code, tmp_path) == str(tmp_path / "seatrial" / "xla")
    assert run_python(code, tmp_path, JAX_COMPILATION_CACHE_DIR="/elsewhere") == "/elsewhere"
