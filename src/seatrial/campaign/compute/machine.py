"""What decides the bits of a computation besides its input: versions, compiler settings and the processor."""

import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from seatrial import __version__

PACKAGES = ("jax", "jaxlib", "jax-cuda12-plugin", "numpy", "scipy", "blackjax", "distributed")


def environment() -> dict[str, str]:
    """Versions and compiler settings; where they differ, results may."""
    found = {"seatrial": __version__, "Python": ".".join(platform.python_version_tuple()[:2])}
    found |= {name: _version(name) for name in PACKAGES}
    return found | {name: os.environ.get(name, "") for name in ("XLA_FLAGS", "JAX_ENABLE_X64", "JAX_PLATFORMS")}


def processor() -> str:
    """Name of this machine's processor; sums may differ in their last bits between two kinds."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


@lru_cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
