"""Measure the structure: sizes, comments, composed sentences, files with one importer, circles, and who takes a whole campaign.

python release/measure.py            a table of src (and studies)
python release/measure.py --single   each file with one importer, and which
python release/measure.py --prose    each function whose work is composing sentences
"""

import argparse
import ast
import io
import re
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACES = ("src/seatrial", "studies")
TESTS = ("tests", "studies")
WORD_PACKAGES = ("messages", "cli", "report", "dashboard")
"""Packages of src whose work is words."""
MIN_WORDS = 4
"""Words of text in a function that returns text, from which it composes sentences."""
TEXT = {
    "str",
    "str | None",
    "list[str]",
    "tuple[str, ...]",
    "Iterator[str]",
    "Iterable[str]",
    "Sequence[str]",
    "dict[str, str]",
}
VAGUE_NAMES = re.compile(r"\b(found|told|said)\b[^=()]{0,20} = ")


def main() -> None:
    """Print the table, or the files with one importer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--single", action="store_true", help="list the files with one importer")
    parser.add_argument("--prose", action="store_true", help="list the functions whose work is composing sentences")
    options = parser.parse_args()
    trees = {
        path: ast.parse(path.read_text(encoding="utf-8"))
        for place in PLACES
        for path in sorted((ROOT / place).rglob("*.py"))
        if "tests" not in path.relative_to(ROOT).parts
    }
    importers = find_importers(trees)
    single = {path: users for path, users in importers.items() if len(users) == 1}
    if options.single:
        for path, (user,) in sorted(single.items()):
            size = len(path.read_text(encoding="utf-8").splitlines())
            print(f"{path.relative_to(ROOT)} ({size}) <- {user.relative_to(ROOT)}")
        return
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in trees}
    prose = [(path, node) for path, tree in trees.items() for node in ast.walk(tree) if composes(path, node)]
    if options.prose:
        print(*(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}" for path, node in prose), sep="\n")  # pyright: ignore[reportAttributeAccessIssue]
        return
    texts = {path: path.read_text(encoding="utf-8") for path in trees}
    tests = [
        path for place in TESTS for path in (ROOT / place).rglob("*.py") if "tests" in path.relative_to(ROOT).parts
    ]
    functions = [node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    print(f"files                              {len(trees):6d}")
    print(f"files without __init__             {sum(path.name != '__init__.py' for path in trees):6d}")
    print(f"lines                              {sum(lines.values()):6d}")
    print(
        f"lines of tests                     {sum(len(path.read_text(encoding='utf-8').splitlines()) for path in tests):6d}"
    )
    print(f"functions                          {len(functions):6d}")
    print(f"functions per 1 000 lines          {1000 * len(functions) / sum(lines.values()):6.1f}")
    print(f"functions over 60 lines            {sum(node.end_lineno - node.lineno >= 60 for node in functions):6d}")  # pyright: ignore[reportOptionalOperand]
    print(f"files with one importer            {len(single):6d}")
    print(f"functions that take a Campaign     {sum(takes_campaign(node) for node in functions):6d}")
    print(f"files in circles of imports        {sum(map(len, circles(importers))):6d}")
    print(f"functions that compose sentences   {len(prose):6d}")
    print(f"modules loaded by a computed name  {sum(map(count_computed_imports, trees.values())):6d}")
    print(f"found, told or said assigned       {sum(len(VAGUE_NAMES.findall(text)) for text in texts.values()):6d}")
    comments = sum(map(count_comments, texts.values()))
    print(f"comments                           {comments:6d}")
    print(f"comments per 1 000 lines           {1000 * comments / sum(lines.values()):6.1f}")
    for place, size in sorted(Counter(_package(path) for path in trees).items()):
        print(f"  {place:32s} {size:4d} files {sum(lines[path] for path in trees if _package(path) == place):6d} lines")


def find_importers(trees: dict[Path, ast.Module]) -> dict[Path, set[Path]]:
    """Return for every file the files that import it, `__init__` files aside."""
    modules = {_module(path): path for path in trees}
    found: dict[Path, set[Path]] = {path: set() for path in trees if path.name != "__init__.py"}
    for path, tree in trees.items():
        for node in ast.walk(tree):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            for target in {modules[name] for name in names if name in modules} - {path}:
                if target in found:
                    found[target].add(path)
    return found


def circles(importers: dict[Path, set[Path]]) -> list[set[Path]]:
    """Return groups of files that import each other in a circle, imports inside functions and for types alone included."""

    def reach(start: Path) -> set[Path]:
        seen, todo = set(), [start]
        while todo:
            for user in importers.get(todo.pop(), ()):
                if user not in seen:
                    seen.add(user)
                    todo.append(user)
        return seen

    above = {path: reach(path) for path in importers}
    found: list[set[Path]] = []
    for path in importers:
        group = {other for other in above[path] if path in above.get(other, ())}
        if path in group and group not in found:
            found.append(group)
    return found


def takes_campaign(node: ast.FunctionDef) -> bool:
    """Return whether an argument is annotated as a whole campaign."""
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return any(
        one.annotation is not None and ast.unparse(one.annotation).strip("'\"") == "Campaign" for one in arguments
    )


def composes(path: Path, node: ast.AST) -> bool:
    """Return whether a function outside the packages of words returns text that it composes, the words of errors aside."""
    package = path.relative_to(ROOT).parts[2 if "seatrial" in path.parts else 0]
    if package in WORD_PACKAGES or not isinstance(node, ast.FunctionDef):
        return False
    if node.returns is None or ast.unparse(node.returns) not in TEXT:
        return False
    body = node.body[1:] if ast.get_docstring(node) is not None else node.body
    return sum(map(_count_words, body)) >= MIN_WORDS


def count_computed_imports(tree: ast.Module) -> int:
    """Count the calls that import a module whose name is not written out there."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return sum(
        ast.unparse(call.func).rpartition(".")[2] == "import_module"
        and not (call.args and isinstance(call.args[0], ast.Constant))
        for call in calls
    )


def count_comments(text: str) -> int:
    """Count comments, those behind code too, without the remarks that address a tool."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return sum(
        token.type == tokenize.COMMENT and not re.match(r"# *(pyright|type|noqa|ruff|fmt):?", token.string)
        for token in tokens
    )


def _count_words(node: ast.AST) -> int:
    """Count the words in the strings of an expression, except those of an `InputError`."""
    if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("InputError"):
        return 0
    if isinstance(node, ast.Constant):
        return len(re.findall(r"\S*[A-Za-z]\S*", node.value)) if isinstance(node.value, str) else 0
    return sum(map(_count_words, ast.iter_child_nodes(node)))


def _module(path: Path) -> str:
    name = path.relative_to(ROOT).with_suffix("").as_posix().removeprefix("src/").replace("/", ".")
    return name.removesuffix(".__init__")


def _package(path: Path) -> str:
    return "/".join(path.relative_to(ROOT).parts[:-1]).removeprefix("src/")


if __name__ == "__main__":
    main()
