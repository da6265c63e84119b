"""seatrial: design trials, estimate hydrodynamic coefficients with their uncertainty, select the terms.

Importing the package is cheap and sets nothing: JAX and the rest load when a name that needs them is first used, and JAX is then set to
float64 (`configure`).
"""

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

_LIGHT = ("seatrial.core.", "seatrial.logs.", "seatrial.compiled.engine")
"""Where nothing computes with JAX."""


@cache
def _homes() -> dict[str, tuple[str, str]]:
    """Return the module of every public name and its name there, from the stub that editors and type checkers read too."""
    # One list for both: with two, a type checker could believe in a name that does not load.
    imported, public = {}, {}
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body:
        match node:
            case ast.ImportFrom(module=str(module), names=names):
                imported |= {each.name: (module, each.name) for each in names}
                public |= {each.name: (module, each.name) for each in names if each.asname}
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Name(id=original)):
                public[name] = imported[original]
            case _:
                pass
    return public


def __dir__() -> list[str]:
    return sorted(["__version__", *_homes()])


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return __dir__()
    # A module has its own private names and many dunder names besides; none of them is in the stub.
    if name.startswith("_") or name not in _homes():
        raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
    module, original = _homes()[name]
    if module == "seatrial":  # a module that is a name itself
        return import_module(f"seatrial.{original}")
    if not module.startswith(_LIGHT):
        from seatrial.compiled import engine

        engine.prepare(tell=True)
    return getattr(import_module(module), original)
