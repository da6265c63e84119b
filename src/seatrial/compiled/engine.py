"""Settings of the numerical engine, made when seatrial first computes or when they are asked for, and never by `import seatrial`.

Three of them matter: float64, the XLA CPU option that compiles a whole time-stepping loop into one kernel (factors 3 to 20 on the
loops of this package; see docs/decisions/0002), and the persistent compilation cache. What a user has already set in the environment is
left alone. When what is set, and why: docs/decisions/0019.
"""

import os
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from seatrial.core.errors import InputError

_LOOP_OPTION = "xla_cpu_small_while_loop_byte_threshold"
_BACKEND_OPTIONS = "--xla_backend_extra_options"
_VECTOR_WIDTH = "--xla_cpu_prefer_vector_width"
# Which compiled code is kept: key of `jax_persistent_cache_…`, and its value as text and type.
_CACHE_LIMITS = {"min_compile_time_secs": ("0.2", float), "min_entry_size_bytes": ("-1", int)}
_REMEDY = "call seatrial.configure() at the start of the program"
_NO = ("0", "false", "f", "no", "n", "off")
_is_prepared = False
_keeps_programs = False
_say: Callable[[str], None] | None = None
_compiling = 0.0
_SLOW_SECONDS = 2.0  # Seconds of compiling after which it is told
BEGAN = time.time()  # When this process began to load the package


class EngineWarning(UserWarning):
    """Settings of JAX that change results of a program, or its speed."""


def configure(cache: bool = True) -> None:
    """Set JAX up for seatrial, as its commands do: float64 for the whole process, XLA's options, and a cache of compiled code.

    Best called before JAX computes anything. Variables of the environment go first: JAX_ENABLE_X64, XLA_FLAGS and
    JAX_COMPILATION_CACHE_DIR stay as they are if they are set.

    Args:
        cache: whether compiled code is kept under `$XDG_CACHE_HOME/seatrial`, by default in `~/.cache`, for later processes: seatrial's
            own programs, ready to run, and what the rest of the program compiles too.
    """
    global _is_prepared, _keeps_programs
    started = _has_computed()
    flags = os.environ.get("XLA_FLAGS", "")
    fuses_time_loops = _BACKEND_OPTIONS in flags
    if started and not fuses_time_loops:
        warnings.warn(
            f"JAX has started without XLA's option for time loops: simulations take 3 to 20 times longer; {_REMEDY}",
            EngineWarning,
            stacklevel=2,
        )
    if not fuses_time_loops:
        flags = f"{flags} {_BACKEND_OPTIONS}={_LOOP_OPTION}=1000000000".strip()
    os.environ["XLA_FLAGS"] = flags if _VECTOR_WIDTH in flags else f"{flags} {_VECTOR_WIDTH}=256"
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    jax = sys.modules.get("jax")
    if _asked_for_float32():
        warnings.warn(
            f"JAX_ENABLE_X64={os.environ['JAX_ENABLE_X64']} sets single precision, which is too low for long simulations and evidences; "
            f"leave it out",
            EngineWarning,
            stacklevel=2,
        )
    elif jax is not None:
        jax.config.update("jax_enable_x64", True)
    if cache:
        _keep_compiled(jax, started)
        allowed = os.environ.get("JAX_ENABLE_COMPILATION_CACHE", "1").lower() not in _NO
        _keeps_programs = allowed and hasattr(os, "O_DIRECTORY")  # how a folder is known to be private
    _is_prepared = True


def prepare(tell: bool = False) -> None:
    """Set what seatrial cannot do without, before the first of its modules that computes is loaded: all of `configure` but the cache.

    Args:
        tell: whether to warn where somebody else's JAX, loaded before, is switched to float64.

    Raises:
        InputError: JAX has already computed in float32 in this process, so that another program relies on it.
    """
    if _is_prepared:
        return
    jax = sys.modules.get("jax")
    if jax is not None and not jax.config.jax_enable_x64 and not _asked_for_float32():
        if _has_computed():
            raise InputError(
                "JAX in this process",
                found="float32, and it has already computed",
                expected="float64, in which seatrial computes",
                remedy=f"{_REMEDY}: it switches all of JAX to float64; or set JAX_ENABLE_X64=1",
            )
        if tell:
            warnings.warn(
                "seatrial computes in float64 and has switched JAX to it, for the rest of this program too; to do so yourself, "
                f"{_REMEDY}",
                EngineWarning,
                stacklevel=3,
            )
    configure(cache=False)


def check_precision() -> None:
    """Check that arrays made now are of double precision, where something else may have changed JAX since it was set up.

    Raises:
        InputError: they are not, though nobody asked for it in the environment.
    """
    jax = sys.modules.get("jax")
    if jax is not None and not jax.config.jax_enable_x64 and not _asked_for_float32():
        raise InputError(
            "JAX in this process",
            found="float32, switched on after seatrial had set float64",
            expected="float64, in which seatrial computes",
            remedy='call jax.config.update("jax_enable_x64", True) first, or compute in float32 in a separate process',
        )


def cache_directory() -> Path:
    """Return the folder of compiled kernels: `$XDG_CACHE_HOME/seatrial/xla`, by default under `~/.cache`."""
    return _cache() / "xla"


def keeps_programs() -> bool:
    """Whether seatrial's own compiled programs are kept, as `configure` was told."""
    return _keeps_programs


def program_directory() -> Path:
    """Folder of these programs, beside those kernels."""
    return _cache() / "programs"


def tell_of_compiling(say: Callable[[str], None]) -> None:
    """Have somebody told, once, that programs are being compiled and kept, when that takes more than two seconds in all."""
    global _say
    _say = say


def compiled_for(seconds: float) -> None:
    """Count the time that a program took to be compiled and kept."""
    global _compiling, _say
    _compiling += seconds
    if _compiling > _SLOW_SECONDS and _say is not None:
        say, _say = _say, None
        say(
            f"compiling programs for this kind of vehicle and data; they are kept in {program_directory()}, and the next run is faster"
        )


def seconds_of_compiling() -> float:
    """Return how long programs took to be compiled so far in this process, all together."""
    return _compiling


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "seatrial"


def _asked_for_float32() -> bool:
    return os.environ.get("JAX_ENABLE_X64", "1").lower() in _NO


def _has_computed() -> bool:
    """Return whether JAX has started a backend, as the first array or compilation does; its settings of XLA are fixed from then on."""
    jax = sys.modules.get("jax")
    if jax is None:
        return False
    kept = jax.config.jax_num_cpu_devices
    try:  # JAX does not say whether one is started, but refuses another number of devices from then on
        jax.config.update("jax_num_cpu_devices", kept + 1)
    except RuntimeError:
        return True
    jax.config.update("jax_num_cpu_devices", kept)
    return False


def _keep_compiled(jax: Any, started: bool) -> None:
    """Set the compilation cache; JAX reads the environment when it is imported and looks at the cache when it first compiles."""
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_directory()))
    for name, (text, _) in _CACHE_LIMITS.items():
        os.environ.setdefault(f"JAX_PERSISTENT_CACHE_{name.upper()}", text)
    if jax is None:
        return
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
    for name, (_, kind) in _CACHE_LIMITS.items():
        jax.config.update(f"jax_persistent_cache_{name}", kind(os.environ[f"JAX_PERSISTENT_CACHE_{name.upper()}"]))
    if started:
        from jax.experimental.compilation_cache import compilation_cache

        compilation_cache.reset_cache()
