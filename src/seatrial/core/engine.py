"""Settings of the numerical engine that must be in place before JAX starts.

Three of them matter: float64, the persistent compilation cache, and the XLA CPU option that compiles a whole
time-stepping loop into one kernel (factors 3 to 20 on the loops of this package; see docs/decisions/0002). What a user has already
set in the environment is left alone.
"""

import os
import sys
from pathlib import Path

_LOOP_OPTION = "xla_cpu_small_while_loop_byte_threshold"
_BACKEND_OPTIONS = "--xla_backend_extra_options"
_VECTOR_WIDTH = "--xla_cpu_prefer_vector_width"


def configure() -> None:
    """Set the environment JAX reads at import; if JAX is imported already, set its configuration instead."""
    _fuse_time_loops()
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_directory()))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    if "jax" in sys.modules:
        jax = sys.modules["jax"]
        jax.config.update("jax_enable_x64", os.environ["JAX_ENABLE_X64"] not in ("0", "false", "False"))
        jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
        for name, kind in (("min_compile_time_secs", float), ("min_entry_size_bytes", int)):
            text = os.environ[f"JAX_PERSISTENT_CACHE_{name.upper()}"]
            jax.config.update(f"jax_persistent_cache_{name}", kind(text))


def cache_directory() -> Path:
    """Folder of compiled kernels: `$XDG_CACHE_HOME/seatrial/xla`, by default under `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "seatrial" / "xla"


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _fuse_time_loops() -> None:
    flags = os.environ.get("XLA_FLAGS", "")
    if _BACKEND_OPTIONS not in flags:
        flags = f"{flags} {_BACKEND_OPTIONS}={_LOOP_OPTION}=1000000000".strip()
    if _VECTOR_WIDTH not in flags:
        flags = f"{flags} {_VECTOR_WIDTH}=256"
    os.environ["XLA_FLAGS"] = flags
