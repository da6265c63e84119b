"""Measure the house: sizes, files with one importer, circles, and who takes a whole campaign.

python release/measure.py            a table of src (and studies)
python release/measure.py --single   each file with one importer, and which
"""

import argparse
import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACES = ("src/seatrial", "studies")
CONFIGURATION = "src/seatrial/campaign/config"
"""The only folder that may read what a campaign file says in its own units."""


def main() -> None:
    """Print the table, or the files with one importer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--single", action="store_true", help="list the files with one importer")
    options = parser.parse_args()
    trees = {
        path: ast.parse(path.read_text(encoding="utf-8"))
        for place in PLACES
        for path in sorted((ROOT / place).rglob("*.py"))
        if "tests" not in path.parts
    }
    importers = find_importers(trees)
    single = {path: users for path, users in importers.items() if len(users) == 1}
    if options.single:
        for path, (user,) in sorted(single.items()):
            size = len(path.read_text(encoding="utf-8").splitlines())
            print(f"{path.relative_to(ROOT)} ({size}) <- {user.relative_to(ROOT)}")
        return
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in trees}
    functions = [node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    print(f"files                              {len(trees):6d}")
    print(f"files without __init__             {sum(path.name != '__init__.py' for path in trees):6d}")
    print(f"lines                              {sum(lines.values()):6d}")
    print(f"functions                          {len(functions):6d}")
    print(f"functions over 60 lines            {sum(node.end_lineno - node.lineno >= 60 for node in functions):6d}")  # pyright: ignore[reportOptionalOperand]
    print(f"files with one importer            {len(single):6d}")
    print(f"functions that take a Campaign     {sum(takes_campaign(node) for node in functions):6d}")
    print(f"files that read campaign.source    {sum(reads_source(path) for path in trees):6d}")
    print(f"files in circles of imports        {sum(map(len, circles(importers))):6d}")
    print(f"comments                           {sum(count_comments(path) for path in trees):6d}")
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


def reads_source(path: Path) -> bool:
    """Return whether a file outside the configuration reads the campaign's tables as written."""
    text = path.read_text(encoding="utf-8")
    return CONFIGURATION not in path.as_posix() and ("campaign.source" in text or "campaign.schema" in text)


def count_comments(path: Path) -> int:
    """Count the lines that are comments."""
    return sum(line.lstrip().startswith("#") for line in path.read_text(encoding="utf-8").splitlines())


def _module(path: Path) -> str:
    name = path.relative_to(ROOT).with_suffix("").as_posix().removeprefix("src/").replace("/", ".")
    return name.removesuffix(".__init__")


def _package(path: Path) -> str:
    return "/".join(path.relative_to(ROOT).parts[:-1]).removeprefix("src/")


if __name__ == "__main__":
    main()
