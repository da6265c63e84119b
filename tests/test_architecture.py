import ast
from pathlib import Path

from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

import seatrial

ROOT = Path(__file__).parents[1]
SOURCES = sorted(Path(seatrial.__file__).parent.rglob("*.py"))
FORBIDDEN = {
    "pickle",
    "cPickle",
    "dill",
    "cloudpickle",
    "marshal",
    "shelve",
    "joblib",
    "yaml",
    "eval",
    "exec",
    "compile",
    "__import__",
}

BETWEEN_OWN_PROCESSES = {"dask_workers.py": {"pickle"}, "programs.py": {"pickle"}}
"""Dask's tasks, never a file: docs/decisions/0016. Compiled programs, in a folder that is the user's own alone: docs/decisions/0023."""


def test_imports_point_downwards_only():
    assert lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True) == EXIT_STATUS_SUCCESS


def test_data_never_becomes_code():
    offences = {path.name: used for path in SOURCES if (used := _modules_and_calls(path) & FORBIDDEN)}
    assert len(SOURCES) > 10
    assert offences == BETWEEN_OWN_PROCESSES


def _modules_and_calls(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Import():
                names |= {alias.name.split(".")[0] for alias in node.names}
            case ast.ImportFrom(module=str(module)):
                names.add(module.split(".")[0])
            case ast.Call(func=ast.Name(id=name)):
                names.add(name)
    return names
