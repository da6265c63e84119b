"""What JAX knows of the function that it traces now: the only place that asks JAX's private modules.

None of it is public. Where a release of JAX lacks it, no call is known to be outside another function, and `jax.jit` serves them all.
"""

from typing import Any

try:
    from jax._src.config import trace_context, trace_context_names
    from jax._src.core import trace_state_clean

    MISSING = ""
except ImportError as cause:
    MISSING = str(cause)

    def trace_context() -> tuple[Any, ...]:
        """Return no settings."""
        return ()

    def trace_context_names() -> tuple[str, ...]:
        """Return no names of settings."""
        return ()

    def trace_state_clean() -> bool:
        """Return False: a function may be traced now."""
        return False


def thread_settings() -> dict[str, Any]:
    """Return what functions are traced under in this thread: what context managers set, some of it beside `jax.config`."""
    return dict(zip(trace_context_names(), trace_context(), strict=True))
