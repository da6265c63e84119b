"""Where compiled programs lie between processes, and the keys under which they are found again.

A key is a digest of everything that decides about the machine code: the package's files, versions, processor, settings, the function, and
the content of whatever was fixed when it was compiled. What has no such digest, a function of the user's own above all, is not kept. The
files are read with pickle, as JAX reads them: from a private folder of the user's cache alone, whole or not at all.
"""

import hashlib
import os
import platform
import stat
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache, partial
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MappingProxyType, MethodType, ModuleType, NoneType
from typing import Any

import jax
import jaxlib.version
import numpy as np
from jax.core import Tracer

from seatrial.compiled import engine, tracing
from seatrial.core.files import atomic_path, remove_orphans
from seatrial.core.processes import cores

MAX_STORE_BYTES = 500 << 20  # Bytes of all files; beyond them those go whose last use is longest ago
OWN_PACKAGES = ("seatrial", "studies")  # Whose files enter the key
_VERSIONED_LIBRARIES = ("jax", "jaxlib", "numpy", "ml_dtypes", "blackjax", "optax")  # Whose versions do
_MAGIC = b"seatrial program 1\n"
# Parts of the names of JAX's settings that do not change what is compiled.
_OF_NO_WEIGHT = ("cache", "log", "dump", "traceback", "axis_env_state")
_PLAIN = (NoneType, bool, int, str, bytes, complex, range, type(Ellipsis))


class NoKey(Exception):
    """Something has no digest that holds in another process."""


class Unusable(Exception):
    """A file or the folder must not be used, or cannot be; in words."""


def key_of(*content: Any) -> str:
    """Return the key of a program: the same in every process in which it would be compiled to the same code.

    Raises:
        NoKey: part of the content may be something else in another process under the same name.
    """
    digest = _Digest()
    parts = [digest.of(one) for one in content]
    settings = jax.config.values | tracing.thread_settings()
    weighty = {name: settings[name] for name in sorted(settings) if not any(word in name for word in _OF_NO_WEIGHT)}
    parts += [digest.of(weighty), digest.of(_machine())]
    parts += [digest.of((package, _sources(package))) for package in sorted(digest.packages)]
    return _joined(*parts).hex()


class _Digest:
    """Digests of values by their content, and the packages of ours that they come from."""

    def __init__(self) -> None:
        self.packages = {"seatrial"}
        self._known: dict[int, tuple[bytes, Any]] = {}
        self._within: list[int] = []

    def of(self, value: Any) -> bytes:
        """Return the digest of a value.

        Raises:
            NoKey: it has none.
        """
        at = id(value)
        if at in self._known:
            return self._known[at][0]
        if at in self._within:  # a function that holds itself
            return _joined(b"within", str(len(self._within) - self._within.index(at)).encode())
        self._within.append(at)
        made = _joined(*self._parts(value))
        self._within.pop()
        self._known[at] = (made, value)
        return made

    def _parts(self, value: Any) -> Iterable[bytes]:
        kind = type(value)
        if kind in _PLAIN:
            return kind.__name__.encode(), repr(value).encode()
        if kind is float:
            return b"float", value.hex().encode()
        if isinstance(value, Enum):
            return b"enum", self.of(kind), value.name.encode()
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return self._array(value)
        if isinstance(value, np.dtype):
            return b"dtype", str(value).encode()
        if isinstance(value, jax.tree_util.PyTreeDef):
            return b"tree", self.of(value.node_data()), *map(self.of, value.children())
        if isinstance(value, CodeType):
            return self._code(value)
        if named := self._name(value):
            return b"name", *named
        if isinstance(value, type):
            if value.__module__ == "builtins":  # which does not name them all: that of functions, for one
                return b"builtin", value.__qualname__.encode()
            raise NoKey(f"the class {value.__qualname__}")
        return self._made_of(value, kind)

    def _made_of(self, value: Any, kind: Any) -> Iterable[bytes]:
        """Digest what is made of other values."""
        if kind in (tuple, list) or (issubclass(kind, tuple) and hasattr(kind, "_fields")):
            return b"sequence", self.of(kind), *map(self.of, value)
        if kind in (dict, MappingProxyType):
            return b"mapping", *(part for pair in value.items() for part in map(self.of, pair))
        if kind in (set, frozenset):
            return b"set", *sorted(map(self.of, value))
        if kind is slice:
            return b"slice", *map(self.of, (value.start, value.stop, value.step))
        if isinstance(value, partial):
            return b"partial", self.of(kind), *map(self.of, (value.func, value.args, value.keywords))
        if kind is MethodType:
            return b"method", self.of(value.__func__), self.of(value.__self__)
        if kind is FunctionType:
            return self._function(value)
        if hasattr(kind, "cache_info"):  # by functools.lru_cache
            return b"cached", self.of(value.__wrapped__)
        if hasattr(kind, "content_of_program"):
            return b"program", *map(self.of, value.content_of_program())
        if isinstance(value, jax.sharding.AbstractMesh) and value.empty:  # JAX 0.12 has one where no mesh is set
            return (b"no mesh",)
        if is_dataclass(value):
            return b"dataclass", self.of(kind), *self._fields(value)
        raise NoKey(f"a {kind.__qualname__}")

    def _array(self, value: Any) -> Iterable[bytes]:
        if isinstance(value, Tracer) or np.dtype(object) == value.dtype or not hasattr(value.dtype, "str"):
            raise NoKey(f"a {type(value).__name__} of {value.dtype}")
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise NoKey("an array of objects")
        return b"array", array.dtype.str.encode(), str(array.shape).encode(), array.tobytes()

    def _name(self, value: Any) -> tuple[bytes, ...]:
        """Return module and name of what is found under them, and nothing for anything else."""
        if isinstance(value, ModuleType):
            return (self._trusted(value.__name__),)
        home, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
        if isinstance(value, BuiltinFunctionType | np.ufunc):
            home, name = home or "builtins", value.__name__
        if not (isinstance(home, str) and isinstance(name, str)):
            return ()
        result = sys.modules.get(home)
        for part in name.split("."):
            result = getattr(result, part, None)
        return (self._trusted(home), name.encode()) if result is value else ()

    def _function(self, function: FunctionType) -> Iterable[bytes]:
        """Digest a function inside a function, with what it holds of that one's variables."""
        home = self._trusted(str(function.__globals__.get("__name__")))
        held = [_held(cell) for cell in function.__closure__ or ()]
        parts = function.__code__, function.__defaults__, function.__kwdefaults__, held
        return b"function", home, function.__qualname__.encode(), *map(self.of, parts)

    def _code(self, code: CodeType) -> Iterable[bytes]:
        return b"code", code.co_code, *map(self.of, (code.co_firstlineno, code.co_names, code.co_consts))

    def _fields(self, value: Any) -> Iterator[bytes]:
        """Digest what tells one dataclass from another of its kind, and its functions, which need not be compared to be called."""
        for field in fields(value):
            content = getattr(value, field.name)
            if field.compare or _is_called(content):
                yield self.of(field.name)
                yield self.of(content)

    def _trusted(self, module: str) -> bytes:
        package = module.partition(".")[0]
        if package in OWN_PACKAGES:
            self.packages.add(package)
        elif (package not in _VERSIONED_LIBRARIES and package not in sys.stdlib_module_names) or package == "__main__":
            raise NoKey(f"something of {module}")
        return module.encode()


def read(folder: Path, key: str) -> bytes | None:
    """Return what lies under a key; None if nothing does.

    Raises:
        Unusable: the folder or the file is not private, or the file is not what was written under this key.
    """
    try:
        with _opened(folder) as handle:
            content = _content(handle, key)
    except FileNotFoundError:
        return None
    except OSError as cause:
        raise Unusable(f"{folder} cannot be read ({cause.strerror})") from cause
    head = len(_MAGIC) + 32
    if content[:head] != _MAGIC + _checksum(key, content[head:]):
        discard(folder, key)
        raise Unusable(f"{folder / key} is damaged")
    return content[head:]


def write(folder: Path, key: str, content: bytes) -> None:
    """Keep something under a key, and drop what is beyond `LARGEST`; nothing is kept once the package's files were changed.

    Raises:
        Unusable: the folder cannot be written to, or is not private.
    """
    if any(_changed(package) for package in OWN_PACKAGES if package in sys.modules):
        return
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        with _opened(folder):
            pass
        with atomic_path(folder / key) as temporary:
            temporary.write_bytes(_MAGIC + _checksum(key, content) + content)
        _make_room(folder, len(content))
    except OSError as cause:
        raise Unusable(f"{folder} cannot be written to ({cause.strerror})") from cause


def discard(folder: Path, key: str) -> None:
    """Remove what lies under a key."""
    with suppress(OSError):
        (folder / key).unlink()


def _checksum(key: str, content: bytes) -> bytes:
    """Return a hash of the content and of the key it belongs to, so that a file under another name is a damaged one."""
    return hashlib.sha256(key.encode() + b"\0" + content).digest()


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    """Open the folder if it is one, private, and no link to another."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        _refuse_shared(os.fstat(handle), folder)
        yield handle
    finally:
        os.close(handle)


def _content(folder: int, key: str) -> bytes:
    file = os.open(key, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=folder)
    with os.fdopen(file, "rb") as stream:
        about = os.fstat(file)
        if not stat.S_ISREG(about.st_mode):
            raise Unusable(f"{key} among the compiled programs is not a file")
        _refuse_shared(about, key)
        with suppress(OSError):
            os.utime(file)  # the last use
        return stream.read()


def _refuse_shared(about: os.stat_result, place: Any) -> None:
    if about.st_uid != os.geteuid() or about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise Unusable(f"{place} belongs to another user, or may be written by others")


_since_look = -1  # Bytes written since the folder was last looked through, below 0 where it was not yet


def _make_room(folder: Path, written: int) -> None:
    """Drop what was unused for longest: looked after at the first file that a process writes, and then now and then."""
    global _since_look
    if 0 <= _since_look < MAX_STORE_BYTES // 20:
        _since_look += written
        return
    _since_look = 0
    remove_orphans(folder)
    with os.scandir(folder) as entries:
        files = [entry for entry in entries if not entry.name.startswith(".") and entry.is_file(follow_symlinks=False)]
    about = []
    for file in files:
        with suppress(FileNotFoundError):  # another process was faster
            about.append((file.stat(follow_symlinks=False), file.path))
    total = sum(one.st_size for one, _ in about)
    for one, path in sorted(about, key=lambda pair: pair[0].st_mtime):
        if total <= MAX_STORE_BYTES:
            return
        with suppress(FileNotFoundError):
            os.unlink(path)
        total -= one.st_size


@lru_cache(maxsize=1)
def _machine() -> tuple[Any, ...]:
    """Return what compiles and what the code is for."""
    devices = jax.devices()
    return (
        sys.version,
        (jax.__version__, jaxlib.version.__version__, np.__version__, *_installed()),
        (devices[0].platform, devices[0].client.platform_version, *(device.device_kind for device in devices)),
        _processor(),
        cores(),
        (os.environ.get("XLA_FLAGS"), os.environ.get("NPROC")),
    )


def _installed() -> list[str]:
    """Return names and versions of the libraries that enter programs, as their installer wrote them down."""
    installed = set()
    for place in filter(os.path.isdir, sys.path):
        installed |= {
            name
            for name in os.listdir(place)
            if name.endswith(".dist-info") and name.split("-")[0] in _VERSIONED_LIBRARIES
        }
    return sorted(installed)


def _processor() -> tuple[str, ...]:
    """Return the processor's model and features; where no file tells them, the name of the machine."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as stream:
            first = stream.read().partition("\n\n")[0]
    except OSError:
        return platform.machine(), platform.processor(), platform.node()
    return platform.machine(), *(line for line in first.splitlines() if line.split(":")[0].strip() in _OF_PROCESSOR)


# Rows of /proc/cpuinfo that hold for the processor and not for the moment, on x86, Arm, POWER and RISC-V.
_OF_PROCESSOR = {
    *("vendor_id", "cpu family", "model", "model name", "stepping", "flags"),
    *("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision", "Features"),
    *("cpu", "revision", "isa", "uarch"),
}


@lru_cache(maxsize=len(OWN_PACKAGES))
def _sources(package: str) -> str:
    """Return a digest of a package's files.

    Raises:
        NoKey: one was changed after this process began, which may have read it before.
    """
    if _changed(package):
        raise NoKey(f"files of {package} that were changed since this process began")
    digest, root = hashlib.sha256(), _root(package)
    for path in _files(package):
        digest.update(str(path.relative_to(root)).encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _changed(package: str) -> bool:
    return any(path.stat().st_ctime > engine.BEGAN for path in _files(package))


def _files(package: str) -> list[Path]:
    """Return the files of a package in the order of their names."""
    walked = os.walk(_root(package))
    return sorted(Path(base, name) for base, _, names in walked if not base.endswith("__pycache__") for name in names)


def _root(package: str) -> Path:
    return Path(sys.modules[package].__path__[0])


def _held(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not assigned yet
        return ...


def _is_called(content: Any) -> bool:
    many = content.values() if isinstance(content, Mapping) else content if isinstance(content, tuple) else (content,)
    return any(map(callable, many))


def _joined(*parts: bytes) -> bytes:
    digest = hashlib.blake2b(digest_size=20)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.digest()
