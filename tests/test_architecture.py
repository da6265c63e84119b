import ast
import re
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


def test_files_are_written_by_one_module():
    """Only it knows links from files: whoever writes does so inside `atomic_path`, to what that calls `temporary`."""
    offences = {path.name for path in SOURCES if path.name != "files.py" and _writes(path)}
    assert offences == {"whole_run.py"}, "which writes beside its file, in the cache of the user"


def _writes(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name(id="temporary"))):
                continue
            case ast.Call(func=ast.Attribute(attr="write_text" | "write_bytes" | "touch")):
                found.append(ast.unparse(node))
            case ast.Call(func=ast.Attribute(attr="open") | ast.Name(id="open" | "FileIO")) if any(
                isinstance(one, ast.Constant) and re.fullmatch("[rbt]*[wax+][wabxt+]*", str(one.value))
                for one in (*node.args, *(keyword.value for keyword in node.keywords))
            ):
                found.append(ast.unparse(node))
            case ast.Attribute(attr="O_WRONLY" | "O_RDWR" | "O_APPEND" | "O_CREAT"):
                found.append(ast.unparse(node))
    return found
