"""Functions whose compiled programs are kept ready for later processes: `program` takes the place of `jax.jit`.

Most of what a user waits for is tracing and lowering, which XLA's own cache does not spare; a program that lies here as an executable
loads in a tenth of the time. What is kept, and when it is found again, is in `program_store`; docs/decisions/0023 says why.
"""

import ctypes
import inspect
import logging
import pickle
import re
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, lru_cache, partial, update_wrapper
from pathlib import Path
from types import MethodType
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache
from jax.tree_util import tree_flatten, tree_structure, tree_unflatten

from seatrial.compiled import engine, program_store, tracing
from seatrial.compiled.program_store import NoKey, Unusable


class Counts(NamedTuple):
    """What this process has done so far.

    Attributes:
        loaded: programs found compiled.
        compiled: programs compiled here, to be kept.
        others: everything else that was compiled, or loaded by XLA: operations outside programs, and functions that are not kept.
    """

    loaded: int
    compiled: int
    others: int


def counts() -> Counts:
    """Return how many programs this process has loaded and compiled."""
    return Counts(_done["loaded"], _done["compiled"], _done["all"] - _done["compiled"])


def program(
    function: Callable | None = None,
    *,
    static_argnums: int | tuple[int, ...] = (),
    static_argnames: str | tuple[str, ...] = (),
    donate_argnums: int | tuple[int, ...] = (),
) -> Any:
    """Compile a function for each kind of arguments, as `jax.jit` does, and keep the programs where `engine.configure` was told so.

    Inside another function that is compiled or differentiated it is part of that one. A program whose fixed arguments cannot be told from
    others in another process, such as a user's own log density, is compiled by `jax.jit` and not kept.

    Args:
        function: to be compiled; pure, and of a module or of a function in one.
        static_argnums: places of the arguments that are fixed in a program; they are hashed and compared.
        static_argnames: names of such arguments.
        donate_argnums: places of the arguments whose memory the result may take.
    """
    if function is None:
        return partial(
            program, static_argnums=static_argnums, static_argnames=static_argnames, donate_argnums=donate_argnums
        )
    return Program(function, _many(static_argnums), _many(static_argnames), _many(donate_argnums))


class Program:
    """A function and its programs, one for each kind of arguments it was called with."""

    def __init__(
        self, function: Callable, static: tuple[int, ...], static_names: tuple[str, ...], donated: tuple[int, ...]
    ):
        update_wrapper(self, function)
        self.__name__: str = getattr(function, "__name__", type(function).__name__)
        self.__qualname__: str = getattr(function, "__qualname__", self.__name__)
        self._function = function
        self._given = static, static_names, donated
        self._donated = donated
        self._jit = jax.jit(
            function,
            static_argnums=static or None,
            static_argnames=static_names or None,
            donate_argnums=donated or None,
        )
        self._entries: dict[Any, _Entry] = {}
        self._by_call: dict[Any, _Entry] = {}

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the function, compiled."""
        if not engine.keeps_programs() or not _is_outermost():
            return self._jit(*args, **kwargs)
        leaves, entry = self._entry(args, kwargs)
        ready = None if entry is None else entry.ready()
        return self._jit(*args, **kwargs) if ready is None else tree_unflatten(ready.out_tree, ready.run(*leaves))

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        """Bind a method."""
        return self if instance is None else MethodType(self, instance)

    def __reduce__(self) -> str:
        """Return the name under which another process finds it."""
        return self.__qualname__

    def clear(self) -> None:
        """Forget the programs in memory."""
        self._entries.clear()
        self._by_call.clear()

    def content_of_program(self) -> tuple[Any, ...]:
        """Return what decides about it, for a digest: a program inside a function has no name of its own."""
        return self._function, self._given

    def lower(self, *args: Any, **kwargs: Any) -> jax.stages.Lowered:
        """As of `jax.jit`."""
        return self._jit.lower(*args, **kwargs)

    def _entry(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> tuple[list[Any], "_Entry | None"]:
        """Return the arrays among the arguments and the place of their program, None if `jax.jit` has to serve them."""
        static, args, kwargs = self._split(args, kwargs)
        leaves, tree = tree_flatten((args, kwargs))
        shapes = tuple(map(_shape_of_call, leaves))
        if any(shape is None for shape in shapes):
            return leaves, None
        try:
            key = (tree, static, shapes, tracing.trace_context())
            entry = self._by_call.get(key)
        except TypeError:  # what cannot be hashed: jax.jit says so better
            return leaves, None
        if entry is None:
            try:
                shapes = tuple(map(_shape, leaves))
            except TypeError:
                return leaves, None
            signature = _Signature(tree, static, shapes, tracing.trace_context())
            entry = self._entries.setdefault(signature, _Entry(partial(self._make, signature)))
            self._by_call[key] = entry
        return leaves, entry

    def _split(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> tuple[tuple, tuple, dict[str, Any]]:
        """Return what is fixed, as (place or name, kind, value), and the other arguments."""
        if not (self._given[0] or self._given[1]):
            return (), args, kwargs
        places, names = self._fixed
        static = [(i, type(x), x) for i, x in enumerate(args) if i in places]
        static += [(name, type(kwargs[name]), kwargs[name]) for name in sorted(kwargs) if name in names]
        rest = tuple(x for i, x in enumerate(args) if i not in places)
        return tuple(static), rest, {name: x for name, x in kwargs.items() if name not in names}

    @cached_property
    def _fixed(self) -> tuple[frozenset[int], frozenset[str]]:
        """Places and names of the fixed arguments, each by both."""
        names = list(inspect.signature(self._function).parameters)
        named = {names.index(name) for name in self._given[1]}
        places = named | {place % len(names) for place in self._given[0]}
        return frozenset(places), frozenset(names[place] for place in places)

    def _make(self, signature: "_Signature") -> "_Ready | None":
        """Load or compile a program; None if it cannot be kept."""
        if any(getattr(jax.config, name) for name in _WITHOUT):
            return None
        try:
            key = f"{re.sub(r'[^a-zA-Z0-9_]', '', self.__name__)}-{program_store.key_of(self, *signature.content())}"
        except NoKey as cause:
            _note("%s is not kept: it depends on %s", self.__qualname__, cause)
            return None
        folder = engine.program_directory()
        stored = _found(folder, key)
        if stored is not None or not _is_writable:
            return stored
        return self._compiled(folder, key, signature)

    def _compiled(self, folder: Path, key: str, signature: "_Signature") -> "_Ready":
        """Compile a program of the arrays alone: functions among the arguments would not go into a file."""
        started = time.monotonic()
        out_tree: Any = None

        def of_arrays(*leaves: Any) -> list[Any]:
            nonlocal out_tree
            args, kwargs = signature.arguments(leaves)
            out, out_tree = tree_flatten(self._function(*args, **kwargs))
            return out

        of_arrays.__name__ = of_arrays.__qualname__ = self.__name__
        lowered = jax.jit(of_arrays, donate_argnums=signature.donated(self._donated)).lower(*signature.structs())
        try:
            kept = pickle.dumps(out_tree)
        except Exception as cause:  # whatever a class of the result says of being pickled
            _note("%s is not kept: %s", self.__qualname__, cause)
            return _Ready(lowered.compile(), out_tree)
        with _without_xla_cache():  # an executable that came out of it loads elsewhere, and then fails
            ready = _Ready(lowered.compile(), out_tree)
        _count("compiled")
        _keep(folder, key, ready.run, kept, len(signature.shapes))
        engine.compiled_for(time.monotonic() - started)
        return ready


class _Ready(NamedTuple):
    """A program: arrays in, arrays out, and how these are put together."""

    run: Any
    out_tree: Any


class _ArrayShape(NamedTuple):
    """What a program knows of an array."""

    shape: tuple[int, ...]
    dtype: Any
    weak: bool


class _Signature(NamedTuple):
    """What a program is compiled for.

    Attributes:
        tree: of the arguments that are not fixed, as (places, names).
        static: those that are, as (place or name, kind, value).
        shapes: of the arrays.
        context: settings of JAX that functions are traced under.
    """

    tree: Any
    static: tuple[tuple[int | str, type, Any], ...]
    shapes: tuple[_ArrayShape, ...]
    context: Any

    def content(self) -> tuple[Any, ...]:
        """Return what a digest is made of."""
        shapes = tuple((one.shape, str(one.dtype), one.weak) for one in self.shapes)
        return self.tree, self.static, shapes

    def structs(self) -> list[jax.ShapeDtypeStruct]:
        """Return the arrays as JAX describes them."""
        return [jax.ShapeDtypeStruct(one.shape, one.dtype, weak_type=one.weak) for one in self.shapes]

    def arguments(self, leaves: tuple[Any, ...]) -> tuple[list[Any], dict[str, Any]]:
        """Put the arguments together."""
        free, kwargs = tree_unflatten(self.tree, leaves)
        args = list(free)
        for place, _, value in self.static:  # in the order of their places
            if isinstance(place, int):
                args.insert(place, value)
            else:
                kwargs[place] = value
        return args, kwargs

    def donated(self, places: tuple[int, ...]) -> tuple[int, ...]:
        """Return the arrays of the arguments at some places."""
        if not places:
            return ()
        numbered, _ = self.arguments(tuple(range(len(self.shapes))))
        return tuple(jax.tree.leaves([numbered[place] for place in places]))


class _Entry:
    """A program that is made once, by whoever needs it first; others wait."""

    def __init__(self, make: Callable[[], _Ready | None]):
        self._lock = threading.RLock()
        self._make: Callable[[], _Ready | None] | None = make
        self._ready: _Ready | None = None

    def ready(self) -> _Ready | None:
        """Return the program; None if `jax.jit` has to serve."""
        if self._make is not None:
            with self._lock:
                if self._make is not None:
                    self._ready = self._make()
                    self._make = None
                    _give_memory_back()
        return self._ready


_c_library = ctypes.CDLL(None) if sys.platform == "linux" else None
_log = logging.getLogger("seatrial")
_lock = threading.RLock()
_done = {"loaded": 0, "compiled": 0, "all": 0}
# Settings of JAX under which nothing is kept.
_WITHOUT = ("jax_disable_jit", "jax_debug_nans", "jax_debug_infs", "jax_default_device")
_is_writable = True
_is_tried = False
_is_told = False
_xla_cache_users = 0


def _give_memory_back() -> None:
    """Return to the system what is free: after compiling the C library keeps some hundred MB of it, in pools that nothing else takes."""
    trim = getattr(_c_library, "malloc_trim", None)
    if trim is not None:
        trim(0)


def _is_outermost() -> bool:
    """Whether no other function is being compiled or differentiated."""
    if tracing.MISSING:
        _tell(f"programs are not kept with this release of JAX ({tracing.MISSING})")
    return tracing.trace_state_clean()


def _many(given: Any) -> tuple:
    return (given,) if isinstance(given, int | str) else tuple(given)


def _shape_of_call(leaf: Any) -> Any:
    """Return what tells one program from another, quickly; None if an argument is none of ours."""
    kind = type(leaf)
    if kind is np.ndarray:
        return leaf.shape, leaf.dtype
    if kind in (float, int, bool, complex) or isinstance(leaf, np.generic):
        return kind
    if isinstance(leaf, Tracer):
        return None
    if isinstance(leaf, jax.Array):
        return None if leaf.committed and len(jax.devices()) > 1 else leaf.aval
    try:
        return _shape(leaf)
    except TypeError:
        return None


def _shape(leaf: Any) -> _ArrayShape:
    about = leaf if isinstance(leaf, jax.ShapeDtypeStruct) else jax.typeof(leaf)
    return _ArrayShape(about.shape, about.dtype, about.weak_type)


def _found(folder: Path, key: str) -> _Ready | None:
    """Load a program; None if there is none that can be used."""
    started = time.monotonic()
    try:
        content = program_store.read(folder, key)
        if content is None:
            return None
        ready = _loaded(content)
    except Unusable as cause:
        _tell(str(cause))
        return None
    except Exception as cause:  # whatever XLA says of code that it cannot load
        program_store.discard(folder, key)
        _tell(f"{folder / key} cannot be loaded ({_first_line(cause)})")
        return None
    _count("loaded")
    _note("Loaded program %s in %.9f sec", key, time.monotonic() - started)
    return ready


def _loaded(content: bytes) -> _Ready:
    executable, arguments, kept = pickle.loads(zlib.decompress(content))
    if b"lapack_" in executable:
        _make_lapack_known()
    out_tree = pickle.loads(kept)
    trees = tree_structure(((0,) * arguments, {})), tree_structure([0] * out_tree.num_leaves)
    run = serialize_executable.deserialize_and_load(executable, *trees, execution_devices=jax.devices()[:1])
    return _Ready(run, out_tree)


@lru_cache(maxsize=1)
def _make_lapack_known() -> None:
    """Have JAX tell XLA where LAPACK's functions are, as it does when it lowers a call of one."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), np.float32))


def _keep(folder: Path, key: str, run: Any, out_tree: bytes, arguments: int) -> None:
    """Write a program, and say once why none can be."""
    global _is_writable, _is_tried
    try:
        executable = serialize_executable.serialize(run)[0]
    except Exception as cause:  # whatever JAX says of a program that has to stay, such as one that calls Python
        _note("%s is not kept: %s", key, cause)
        return
    content = zlib.compress(pickle.dumps((executable, arguments, out_tree)), 1)
    try:
        if not _is_tried:  # some processors' code is written, and then refused
            _loaded(content)
        program_store.write(folder, key, content)
        _is_tried = True
    except Unusable as cause:
        _is_writable = False
        _tell(str(cause))
    except Exception as cause:  # whatever XLA says
        _is_writable = False
        _tell(f"compiled programs cannot be loaded here ({_first_line(cause)})")


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]


def _tell(why: str) -> None:
    """Say, once in a process, why programs are compiled that should have been ready."""
    global _is_told
    with _lock:
        was_reported, _is_told = _is_told, True
    if not was_reported:
        _log.warning("caution: %s: results are the same, and take longer", why)


def _note(text: str, *about: Any) -> None:
    """Write down what became of a program, where JAX writes down what it compiles."""
    _log.log(logging.WARNING if jax.config.jax_log_compiles else logging.DEBUG, text, *about)  # pyright: ignore[reportAttributeAccessIssue]


def _count(what: str) -> None:
    with _lock:
        _done[what] += 1


def _hear(event: str, seconds: float, **_: Any) -> None:
    if event == "/jax/core/compile/backend_compile_duration":
        _count("all")


jax.monitoring.register_event_duration_secs_listener(_hear)


@contextmanager
def _without_xla_cache() -> Iterator[None]:
    """Switch XLA's cache off; whatever else is compiled meanwhile does without it too."""
    global _xla_cache_users
    if not (jax.config.jax_enable_compilation_cache and jax.config.jax_compilation_cache_dir) and not _xla_cache_users:  # pyright: ignore[reportAttributeAccessIssue]
        yield
        return
    with _lock:
        _xla_cache_users += 1
        _switch_xla_cache(False)
    try:
        yield
    finally:
        with _lock:
            _xla_cache_users -= 1
            if not _xla_cache_users:
                _switch_xla_cache(True)


def _switch_xla_cache(on: bool) -> None:
    if jax.config.jax_enable_compilation_cache != on:  # pyright: ignore[reportAttributeAccessIssue]
        jax.config.update("jax_enable_compilation_cache", on)
        compilation_cache.reset_cache()  # JAX looks at the setting once
