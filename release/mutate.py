"""Change the code in a hundred small ways and see whether the nearest tests notice: `python release/mutate.py`.

Each mutant is one change of one expression, made in a copy of the tree, never here; the same code gives the same mutants. Only the
test files that use the changed function most run, up to the first failure, and that test has to pass without the change. What is known
is kept in outputs/mutation: an interrupted run goes on, and a survivor is tried again once its tests have changed. Exits with 3 where
fewer than 95 % are killed.
"""

import argparse
import ast
import difflib
import hashlib
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections import Counter, defaultdict, deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from queue import Queue
from threading import Lock

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "outputs" / "mutation"
SHARE = {"estimation": 30, "selection": 30, "filters": 10, "design": 20, "export": 10}
"""Mutants of each package."""
PER_FILE = 3
"""Mutants of one file at most."""
NEAREST = 6
"""Test files that run for a mutant at most."""
DEPTH = 8
"""Callers between a function and a test at most."""
LIMIT = 900
"""Seconds after which a change that makes the tests hang counts as killed."""
ENOUGH = 0.95
EQUIVALENT: dict[str, str] = {
    "src/seatrial/filters/unscented.py, _minus: return tuple(0.0 if x is y else x - y for x, y in zip(a, b, strict=True)) => "
    "return tuple((x - y) for x, y in zip(a, b, strict=True))": "a number less itself is 0",
    "src/seatrial/export/targets/gz.py, _part: moments = inertia_elements(PART_INERTIA * np.eye(3)) => "
    "moments = inertia_elements(PART_INERTIA * np.eye(4))": "three rows and columns are read",
    "src/seatrial/design/trial_plan.py, TrialPlan.follow: first = autopilot.controls(begin, tuple(column[0] for column in columns)) => "
    "first = autopilot.controls(begin, tuple(column[1] for column in columns))": "what the first step replaces",
    "src/seatrial/export/manoeuvre.py, _steady: top = next((top for top in 10.0 ** np.arange(0.0, 7.0) if surge(speed, top) > 0), None)"
    " => top = next((top for top in 15.0 ** np.arange(0.0, 7.0) if surge(speed, top) > 0), None)": "another bracket of the same root",
    "src/seatrial/estimation/posterior/replicate.py, replicate: noise_keys = "
    "jax.random.split(keys[1], (len(output.labels), len(data.channels))) => "
    "noise_keys = jax.random.split(keys[2], (len(output.labels), len(data.channels)))": "an index beyond two keys is that of the last",
    "src/seatrial/estimation/diagnostics/combinations.py, _best: while len(members) > 2: => "
    "while len(members) >= 2:": "one parameter within 5 % of two is "
    "no better than the best alone, and then the sum of least variance is taken of all",
    "src/seatrial/estimation/priors/truncated.py, TruncatedNormal.draw: inside = jnp.nextafter(self.lower + margin, inf), "
    "jnp.nextafter(self.upper - margin, -inf) => inside = jnp.nextafter(self.lower + margin, inf), "
    "jnp.nextafter(self.upper + margin, -inf)": "a margin that one draw in 1e12 reaches",
    "src/seatrial/estimation/posterior/profile.py, climb: damping[row] = max(damping[row] / 10, 1e-6) => "
    "damping[row] = max((damping[row]), 1e-6)": "another damping of the same climb",
    "src/seatrial/estimation/regression/equation_error.py, _regress: z = phi if speed is trial.speed else "
    "np.asarray(_regressors(model, np.asarray(speed), control)[1]) => z = "
    "(np.asarray(_regressors(model, np.asarray(speed), control)[1]))": "the same regressors, computed twice",
    "src/seatrial/estimation/simulation/sensor_errors.py, lags_before: safe = jnp.where(small, 1.0, r) => "
    "safe = jnp.where(small, 1.5, r)": "what stands in for a divisor where the quotient is not used",
    "src/seatrial/estimation/regression/rows.py, _depth: return int((row - column).max(initial=0)) + 1 => "
    "return int((row - column).max(initial=0)) + 2": "one diagonal more, of zeros",
    "src/seatrial/estimation/simulation/delayed_control.py, delay_control: here, before = (from_on(xp.maximum(start, 0)) for start in "
    "(first, first - 1)) => here, before = (from_on(xp.maximum(start, 1)) for start in (first, first - 1))": "the first value is "
    "there once more than is read",
    "src/seatrial/estimation/simulation/sensor_errors.py, Sensor.show: if memory is not None and lag is not None: => "
    "if memory is not None or lag is not None:": "a sensor has both or neither",
    "src/seatrial/estimation/simulation/delayed_control.py, delay_control.from_on: return held[start : start + n] if xp is np else "
    "jax.lax.dynamic_slice(held, (start,), (n,)) => return (jax.lax.dynamic_slice(held, (start,), (n,)))": "the same slice by JAX",
    "src/seatrial/design/utility_agreement.py, _spearman: return np.divide((a * b).sum(1), scale, out=np.full(len(a), np.nan), "
    "where=scale > 0) => return np.divide((a * b).sum(1), scale, out=np.full(len(a), np.nan), where=scale > 1)": "ranks of five designs "
    "and more that are not all alike spread by more than one",
    "src/seatrial/filters/unscented.py, UnscentedKalmanFilter.predict: deviations = [_minus(image, mean) for image in images] => "
    "deviations = [_minus(mean, image) for image in images]": "only products of two deviations are taken",
    "src/seatrial/filters/run.py, _pass: begin = (_arrays(start), tuple(control[0]), step[0], grows[0], zero, zero) => "
    "begin = (_arrays(start), tuple(control[0]), step[0], grows[1], zero, zero)": "the growth before the first sample, to which "
    "nothing is predicted",
    "src/seatrial/estimation/regression/regressor_noise.py, _at: trial, signals={**trial.signals, **{name: trial.signals[name] + times * e "
    "for name, e in noise.items()}} => trial, signals={**trial.signals, **{name: trial.signals[name] - times * e "
    "for name, e in noise.items()}}": "each noise is added and subtracted anyway, and the mean of both taken",
    "src/seatrial/export/from_campaign.py, _with_rest: if not same_mass(alone.hull, published.hull): => "
    "if not same_mass(published.hull, alone.hull):": "the same question of the same two",
    "src/seatrial/design/sweep.py, Sweep.controls: self.family, trim or self.trim, self.amplitude[row : row + 1], "
    "self.period[column : column + 1] => self.family, trim or self.trim, self.amplitude[row : row + 1], "
    "self.period[column : column + 2]": "one design more, of which the first is taken",
    "src/seatrial/selection/subsets/sampler.py, walk: if now == half - 1: => if now == (half):": "the same structures, taken one move "
    "later, before those of that move are merged",
    "src/seatrial/selection/subsets/sampler.py, walk: if now == half - 1 or now == moves - 1 or (now + 1) % REFRESH_MOVES == 0: => "
    "if now == half - 1 or now == moves - 1 or ((now)) % REFRESH_MOVES == 0:": "the same matrices made anew, and the same structures "
    "merged, one move later",
    "src/seatrial/selection/subsets/sampler.py, walk: if now == half - 1 or now == moves - 1 or (now + 1) % REFRESH_MOVES == 0: => "
    "if now == half - 1 or now == moves - 1 or (now + 1) % REFRESH_MOVES != 0:": "the same, made anew and merged at nearly every move",
    "src/seatrial/estimation/prediction/fitted_range.py, _samples: return np.remainder(values + np.pi, 2 * np.pi) - np.pi if name == "
    '"phi" else values => return np.remainder(values - np.pi, 2 * np.pi) - np.pi if name == "phi" else values': "a full turn "
    "less, of which the remainder knows nothing",
    "src/seatrial/selection/log_evidence.py, run_task: cold = sample_cold(posterior, smc, fold_in(key, 1), settings.smc) => "
    "cold = sample_cold(posterior, smc, fold_in(key, 2), settings.smc)": "another stream of random numbers",
    "src/seatrial/filters/unscented.py, UnscentedKalmanFilter.predict: tuple(plus(p, dot(noise[i], noise[j])) for j, p in "
    "enumerate(row[: i + 1])) => tuple(plus(p, dot(noise[j], noise[i])) for j, p in enumerate(row[: i + 1]))": "a product of the same two",
    "src/seatrial/estimation/posterior/mode.py, _profile: "
    "for reach in NEAR * np.sqrt(mode.cov[at, at]) * 2.0 ** np.arange(DOUBLINGS + 1): => "
    "for reach in NEAR * np.sqrt(mode.cov[at, at]) * 3.0 ** np.arange(DOUBLINGS + 1):": "other ends beyond which nothing is left",
}
"""Mutants that no test can kill, by what `python release/mutate.py --list` prints, and why."""

FLIPPED = {
    ast.Lt: ">=",
    ast.LtE: ">",
    ast.Gt: "<=",
    ast.GtE: "<",
    ast.Eq: "!=",
    ast.NotEq: "==",
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.And: "or",
    ast.Or: "and",
}
SHIFTED = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
"""Comparisons with the boundary moved: of whole numbers only, since on real ones it is the same comparison with probability one."""
EXTREMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
SYMMETRIC = {
    "hypot",
    "logaddexp",
    "isinstance",
    "min",
    "max",
    "minimum",
    "maximum",
    "zip",
    "isclose",
    "allclose",
    "array_equal",
    "fold_in",
    "add",
    "multiply",
    "_correlation",
}
"""Calls whose first two arguments may be exchanged, or must not be."""
SHOWN = {"progress", "share", "report", "told", "print", "warn"}
"""Calls that only tell somebody something."""
TUNING = {
    "maxsize",
    "max_workers",
    "rtol",
    "atol",
    "tol",
    "gtol",
    "ftol",
    "xtol",
    "maxiter",
    "max_steps",
    "batch_size",
    "cpu",
    "strict",
}
"""Keywords whose value is a tuning or a guard: with another value right input gives the same result."""


@dataclass(frozen=True)
class Mutant:
    """One change: of the characters from `start` to `end` of a file, counted in its text."""

    file: str
    where: str
    start: int
    end: int
    new: str

    def apply(self, text: str) -> str:
        """Return the text of the file with the change made."""
        return text[: self.start] + self.new + text[self.end :]

    @property
    def name(self) -> str:
        """What it changes, without line numbers: the same as long as that line is the same."""
        before = text_of(self.file)
        first, last = before.rfind("\n", 0, self.start) + 1, before.find("\n", self.end)
        old, new = before[first:last], before[first : self.start] + self.new + before[self.end : last]
        return f"{self.file}, {self.where}: {' '.join(old.split())} => {' '.join(new.split())}"

    @property
    def tests(self) -> tuple[str, ...]:
        """The test files to try it on."""
        return nearest_tests(self.file, self.where)

    def diff(self) -> str:
        """Return the change as a unified diff."""
        before = text_of(self.file)
        old, new = (text.splitlines(keepends=True) for text in (before, self.apply(before)))
        return "".join(difflib.unified_diff(old, new, self.file, self.file, n=2))


def main() -> int:
    """Try every mutant that is not known yet, and say which survive."""
    options = _options()
    mutants = [one for package in options.package or SHARE for one in choose(package, options.seed)]
    if options.list:
        print(*(f"{one.name}\n    {' '.join(one.tests)}" for one in mutants), sep="\n")
        return 0
    known = State(FOLDER / "known.json")
    waiting = sorted((one for one in mutants if known.outcome(one) is None), key=lambda one: _chance(options.seed, one))
    trees: Queue[Path] = Queue()
    every = sorted({test for one in waiting for test in one.tests})
    for number in range(options.jobs if waiting else 0):
        trees.put(tree := copy_tree(FOLDER / f"tree-{number}"))
        if not number and (failed := failing_test(tree, ["--collect-only", *every], shlex.split(options.prefix))):
            sys.exit(f"the tests cannot be collected before any change is made: {failed}")

    def work(mutant: Mutant) -> None:
        tree = trees.get()
        try:
            known.add(mutant, attempt(mutant, tree, shlex.split(options.prefix), known))
        finally:
            trees.put(tree)
        print(f"{known.outcome(mutant)}: {mutant.name}", flush=True)

    with ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(work, waiting))
    return _say(mutants, known)


def choose(package: str, seed: int) -> list[Mutant]:
    """Return the mutants of a package: those of least hash, few of one file and one of a line."""
    found = [one for path in sorted((ROOT / "src/seatrial" / package).rglob("*.py")) for one in mutants_of(path)]
    chosen: list[Mutant] = []
    for one in sorted(found, key=lambda one: _chance(seed, one)):
        line = text_of(one.file).count("\n", 0, one.start)
        same = [other for other in chosen if other.file == one.file]
        taken = {text_of(other.file).count("\n", 0, other.start) for other in same}
        if one.name not in EQUIVALENT and len(same) < PER_FILE and line not in taken and one.tests:
            chosen.append(one)
        if len(chosen) == SHARE[package]:
            break
    return chosen


def _chance(seed: int, one: Mutant) -> bytes:
    """Return a mutant's place in the order of a seed, over all packages, so that an interrupted run is a fair part of the whole."""
    return hashlib.sha256(f"{seed} {one.name}".encode()).digest()


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Yield every change of a file: of comparisons, operators, signs, constants, terms, arguments and extremes."""
    file = path.relative_to(ROOT).as_posix()
    text = text_of(file)
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    lines = text.splitlines()

    def at(line: int, column: int) -> int:
        return starts[line - 1] + len(lines[line - 1].encode()[:column].decode())

    def ends(node: ast.expr) -> tuple[int, int]:
        return at(node.lineno, node.col_offset), at(node.end_lineno or 0, node.end_col_offset or 0)

    for where, node in _expressions(ast.parse(text)):
        for start, end, new in _changes(node, text, ends):
            if not text[start:end].startswith("#"):
                yield Mutant(file, where, start, end, new)


def _expressions(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Yield expressions inside functions that compute something: no words, annotations, decorators, defaults and tunings."""
    waiting: deque[tuple[str, ast.AST]] = deque(("", node) for node in tree.body)
    while waiting:
        where, node = waiting.popleft()
        if isinstance(node, (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom, ast.Lambda)) and not (
            isinstance(node, ast.Lambda) and where
        ):
            continue
        if isinstance(node, ast.Call) and _called(node) in SHOWN:
            continue
        if isinstance(node, ast.keyword) and node.arg in TUNING:
            continue
        if isinstance(node, ast.Call) and _called(node) == "reshape":
            waiting.extend((where, child) for child in [node.func, *node.args] if ast.unparse(child) != "-1")
            continue
        inside = where
        children: list[ast.AST] = list(ast.iter_child_nodes(node))
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            inside = f"{where}.{node.name}".strip(".")
            children = list(node.body)
            if isinstance(node, ast.ClassDef):
                children = [child for child in node.body if isinstance(child, (ast.FunctionDef, ast.ClassDef))]
        if isinstance(node, ast.AnnAssign):
            children = [node.value] if node.value else []
        if isinstance(node, ast.arg):
            continue
        if isinstance(node, ast.expr) and where:
            yield where, node
        if where or isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            waiting.extend((inside, child) for child in children)


def _changes(node: ast.expr, text: str, ends) -> Iterator[tuple[int, int, str]]:
    """Yield what may be put in place of an expression or of its operator: start, end, new text."""
    start, end = ends(node)
    match node:
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in FLIPPED:
            between = ends(left)[1], ends(right)[0]
            yield (*between, _padded(text[slice(*between)], FLIPPED[type(op)]))
            if type(op) in SHIFTED and (_whole(left) or _whole(right)):
                yield (*between, _padded(text[slice(*between)], SHIFTED[type(op)]))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in FLIPPED and not _words(node):
            between = ends(left)[1], ends(right)[0]
            if text[slice(*between)].strip() in "+-*/":
                yield (*between, _padded(text[slice(*between)], FLIPPED[type(op)]))
                yield start, end, f"({text[slice(*ends(left))]})"
        case ast.BoolOp(values=[left, right], op=op):
            between = ends(left)[1], ends(right)[0]
            if text[slice(*between)].strip() in ("and", "or"):
                yield (*between, _padded(text[slice(*between)], FLIPPED[type(op)]))
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield start, end, f"({text[slice(*ends(operand))]})"
        case ast.Constant(value=bool(value)):
            yield start, end, str(not value)
        case ast.Constant(value=int(value)):
            yield start, end, str(value + 1)
        case ast.Constant(value=float(value)) if 1e-2 <= abs(value) <= 1e3:
            yield start, end, repr(1.5 * value)
        case ast.Call(args=[first, second, *_]) if _called(node) not in SYMMETRIC and not _literal(first, second):
            one, other = ends(first), ends(second)
            yield one[0], other[1], text[slice(*other)] + text[one[1] : other[0]] + text[slice(*one)]
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in EXTREMES and len(node.args) > 1:
            place = ends(node.func)[1]
            yield place - len(name), place, EXTREMES[name]
        case ast.IfExp(body=body, orelse=other) if not _words(body):
            yield start, end, f"({text[slice(*ends(other))]})"


def _padded(between: str, operator: str) -> str:
    """Return the text between two operands with its operator exchanged."""
    (old,) = [part for part in between.replace("(", " ").replace(")", " ").split() if part not in "\\"] or [""]
    return between.replace(old, operator, 1) if old else between


def _called(node: ast.Call) -> str:
    return getattr(node.func, "id", None) or getattr(node.func, "attr", "")


def _whole(node: ast.expr) -> bool:
    """Whether an expression is plainly a whole number."""
    counts = isinstance(node, ast.Call) and _called(node) == "len"
    sizes = isinstance(node, ast.Attribute) and node.attr in ("size", "ndim", "dim")
    return counts or sizes or bool(isinstance(node, ast.Constant) and type(node.value) is int and node.value)


def _words(node: ast.AST) -> bool:
    """Whether an expression makes a text."""
    return any(
        isinstance(one, ast.JoinedStr) or (isinstance(one, ast.Constant) and isinstance(one.value, str))
        for one in ast.walk(node)
    )


def _literal(first: ast.expr, second: ast.expr) -> bool:
    """Whether two arguments cannot be told apart, or are spread out of a list."""
    return ast.dump(first) == ast.dump(second) or any(isinstance(one, ast.Starred) for one in (first, second))


@cache
def nearest_tests(file: str, where: str) -> tuple[str, ...]:
    """Return the test files that use a function most: by its name, through what calls it, in its own package before others.

    A mention counts a quarter for each caller between; files with less than a tenth of the best one's count are left out.
    """
    outer, *inner = where.split(".")
    (_, users), mentions = _uses(), Counter[str]()
    weight, seen, ring = 1.0, set[Name](), {(_module(file), outer)}
    while ring and weight > 0.25**DEPTH:
        seen |= ring
        found = Counter({user: count for name in ring for user, count in users[name].items() if user not in seen})
        for (module, _), count in found.items():
            if _is_test(module):
                mentions[f"{module.replace('.', '/')}.py"] += weight * min(count, 10)
        weight, ring = weight / 4, {user for user in found if not _is_test(user[0])}
    for test in mentions:
        mentions[test] *= (3 if test.split("/")[1] == file.split("/")[2] else 1) * (
            2 if inner and f".{inner[-1]}" in text_of(test) else 1
        )
    best = mentions.most_common(NEAREST)
    return tuple(test for test, count in best if count > 0.1 * best[0][1])


Name = tuple[str, str]
"""Module and name of a definition at its top; the name is empty for a whole test file."""


@cache
def _uses() -> tuple[dict[str, dict[str, Name]], dict[Name, Counter[Name]]]:
    """Return what each module imports under which name, and for every definition who mentions it and how often."""
    trees = {
        _module(path.relative_to(ROOT).as_posix()): ast.parse(text_of(path.relative_to(ROOT).as_posix()))
        for path in sorted([*(ROOT / "src").rglob("*.py"), *(ROOT / "tests").rglob("*.py")])
    }
    imported = {module: _imported(tree) for module, tree in trees.items()}

    def origin(name: Name) -> Name:
        module, last = name
        further = imported.get(module, {}).get(last)
        return origin(further) if further and further != name else name

    users: dict[Name, Counter[Name]] = defaultdict(Counter)
    for module, tree in trees.items():
        known, own = imported[module], {name for node in tree.body for name in _defined(node)}
        for node in tree.body:
            inside = [("" if _is_test(module) else name) for name in _defined(node)] or [""]
            for one in ast.walk(node):
                name: Name | None = None
                if isinstance(one, ast.Name):
                    name = known.get(one.id) or ((module, one.id) if one.id in own else None)
                elif isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name) and one.value.id in known:
                    name = (".".join(filter(None, known[one.value.id])), one.attr)
                if name:
                    users[origin(name)].update((module, user) for user in inside)
    return imported, users


def _imported(tree: ast.Module) -> dict[str, Name]:
    """Return where each imported name of a module comes from."""
    found: dict[str, Name] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {one.asname or one.name: (node.module, one.name) for one in node.names}
        elif isinstance(node, ast.Import):
            found |= {one.asname: (one.name, "") for one in node.names if one.asname}
    return found


def _defined(node: ast.stmt) -> list[str]:
    """Return the names that a statement at the top of a module defines."""
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)]


def _module(file: str) -> str:
    return file.removeprefix("src/").removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _is_test(module: str) -> bool:
    return module.startswith("tests.") and module.rpartition(".")[2].startswith("test_")


class State:
    """What is known of mutants, on disk: killed by which test, or survived which text of the tests."""

    def __init__(self, path: Path):
        self.path, self.lock = path, Lock()
        self.known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"mutants": {}, "passes": {}}

    def outcome(self, mutant: Mutant) -> str | None:
        """Return how a mutant ended; None where it has to be tried."""
        entry = self.known["mutants"].get(mutant.name)
        if entry is None or entry["source"] != _digest(mutant.file):
            return None
        if entry["outcome"] == "survived" and entry["tests"] != _digest(*mutant.tests):
            return None
        return entry["outcome"]

    def add(self, mutant: Mutant, outcome: str) -> None:
        """Keep how a mutant ended."""
        entry = {"source": _digest(mutant.file), "tests": _digest(*mutant.tests), "outcome": outcome}
        with self.lock:
            self.known["mutants"][mutant.name] = entry
            self._write()

    def passes(self, test: str) -> bool | None:
        """Return whether a test passes on the code as it is; None where that is not known."""
        return self.known["passes"].get(f"{test} {_digest(test.partition('::')[0])}")

    def add_pass(self, test: str, passes: bool) -> None:
        """Keep whether a test passes on the code as it is."""
        with self.lock:
            self.known["passes"][f"{test} {_digest(test.partition('::')[0])}"] = passes
            self._write()

    def _write(self) -> None:
        self.path.write_text(json.dumps(self.known, indent=1), encoding="utf-8")


def attempt(mutant: Mutant, tree: Path, prefix: list[str], known: State) -> str:
    """Return how the nearest tests end with a mutant in the copy of the tree; those of `make proof` run last."""
    file, tests = tree / mutant.file, mutant.tests
    before = text_of(mutant.file)
    for marker in ("not proof", "proof"):
        file.write_text(mutant.apply(before), encoding="utf-8")
        try:
            failed = failing_test(tree, [*tests, "-m", marker], prefix)
        finally:
            file.write_text(before, encoding="utf-8")
        if failed in ("timeout", "collection"):
            return f"killed by {failed}"
        if failed and known.passes(failed) is None:
            known.add_pass(failed, failing_test(tree, [failed], prefix) is None)
        if failed:
            return f"killed by {failed}" if known.passes(failed) else f"unknown: {failed} fails on the code as it is"
    return "survived"


def failing_test(tree: Path, arguments: list[str], prefix: list[str]) -> str | None:
    """Return the first test that fails in a tree, `timeout`, `collection` where none could start, None where all pass."""
    command = [
        *prefix,
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-rfE",
        "--tb=no",
        "-p",
        "no:cacheprovider",
        *arguments,
    ]
    environment = os.environ | {"PYTHONPATH": f"{tree / 'src'}", "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "1000"}
    run = subprocess.Popen(
        command,
        cwd=tree,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        said, _ = run.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        return "timeout"
    if run.returncode in (0, 5):
        return None
    lines = [
        line.split(" ", 1)[1].split(" - ")[0] for line in said.splitlines() if line.startswith(("FAILED ", "ERROR "))
    ]
    return lines[0] if lines and "::" in lines[0] else "collection"


def copy_tree(folder: Path) -> Path:
    """Return a copy of what git keeps, as it is now."""
    shutil.rmtree(folder, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    return folder


@cache
def text_of(file: str) -> str:
    """Return the text of a file of this tree."""
    return (ROOT / file).read_text(encoding="utf-8")


def _digest(*files: str) -> str:
    return hashlib.sha256("".join(map(text_of, files)).encode()).hexdigest()[:16]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--package", action="append", choices=SHARE, help="only these packages")
    parser.add_argument("--seed", type=int, default=0, help="another hundred")
    parser.add_argument("--jobs", type=int, default=2, help="tests at once")
    parser.add_argument("--prefix", default="", help='put before each command, for example "nice"')
    parser.add_argument("--list", action="store_true", help="print the mutants and their tests, and run nothing")
    return parser.parse_args()


def _say(mutants: list[Mutant], known: State) -> int:
    """Print survivors and counts; the exit code."""
    outcomes = {one: known.outcome(one) or "unknown" for one in mutants}
    alive = [one for one, outcome in outcomes.items() if not outcome.startswith("killed")]
    for one in alive:
        print(f"\n{outcomes[one]}: {one.name}\n    tests: {' '.join(one.tests)}\n{one.diff()}")
    counts = Counter(outcome.split(" by ")[0] for outcome in outcomes.values())
    hung = sum(outcome == "killed by timeout" for outcome in outcomes.values())
    share = 1 - len(alive) / max(len(mutants), 1)
    print(f"{len(mutants)} mutants, {share:.0%} killed ({hung} by running out of time): {dict(counts)}")
    print(*(f"equivalent, left out: {name}: {why}" for name, why in EQUIVALENT.items()), sep="\n")
    return 0 if share >= ENOUGH else 3


if __name__ == "__main__":
    sys.exit(main())
