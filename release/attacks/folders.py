"""Campaign folders under attack: damaged results, changed keys, kills, clocks, two processes, disks.

The judge is a run of the same campaign that nothing disturbs: whatever happens, a command ends with its bits, or refuses in clear words.
"""

import contextlib
import hashlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Any

from attacks.outcome import Outcome, Watchman, command, told

DAMAGES = ("empty", "half", "flipped", "junk", "folder", "gone")
RESULTS = 150
"""Cases of damaged results: more than files times damages, so that places of flips differ."""
FILES_OF = {
    "design": "results/design.nc",
    "simulate": "results/records/",
    "import": "results/records/",
    "estimate": "results/posterior/",
    "select": "results/selection.json",
    "predict": "results/predictions.nc",
    "next": "results/next.nc",
}
"""Results of each step that `standing` judges."""
FINE_CODES = (0, 2, 3, 4)
LOG = "t,speed,propeller\n" + "".join(
    f"{0.1 * k:.1f},{1.4 + 0.1 * (k % 40 > 20) + 0.001 * (k * 7 % 11):.4f},{1100 + 200 * (k % 40 > 20)}\n"
    for k in range(300)
)
IMPORT = """
[import]
fit = ["1"]
[[import.files]]
path = "run_{run}.csv"
time = { column = "t", unit = "s" }
channels.u = { column = "speed", unit = "m/s" }
channels.n = { column = "propeller", unit = "rpm" }
"""


def damaged_result(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Damage one file of a finished campaign, and run it again."""
    _, reference = finished("simulated", place.parent.parent)
    shutil.copytree(reference.folder, place)
    files = sorted(
        path for path in place.rglob("*") if path.is_file() and path.name not in ("campaign.toml", ".seconds")
    )
    victim = files[number % len(files)]
    how = DAMAGES[number // len(files) % len(DAMAGES)]
    _damage(victim, how, random)
    what = f"{victim.relative_to(place)} {how}"
    return _run_again(place, reference, watchman, what)


def changed_key(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Change a key of a finished campaign and run it again: results are those of a campaign that never knew the old value."""
    which, name, old, new = CHANGES[number]
    text, reference = finished(which, place.parent.parent)
    if old not in text and old != "+":
        return Outcome("abort", f"{name}: the attack is out of date, {old!r} is not in the campaign")
    changed = text + new if old == "+" else text.replace(old, new, 1)
    shutil.copytree(reference.folder, place)
    fresh = place.with_name(f"{place.name}-fresh")
    shutil.rmtree(fresh, ignore_errors=True)
    _write(fresh, changed)
    (place / "campaign.toml").write_text(changed)
    if name.startswith("log "):
        for folder in (place, fresh):
            (folder / "run_1.csv").write_text(LOG.replace("1.4", "1.3", 5))
    try:
        called = [step.name for step in _standing(place) if step.state == "current"]
        codes, texts = zip(*(_command("run", folder) for folder in (place, fresh)), strict=True)
        if any(code == 1 for code in codes):
            return Outcome("traceback", f"{name}: {texts}")
        if codes[0] != codes[1]:
            return Outcome(
                "different",
                f"{name}: exit status {codes[0]}, and {codes[1]} without the old results: {texts[0][-300:]}",
            )
        if codes[1] not in (0, 3):
            return Outcome("refused", f"{name}: {texts[1]}")
        theirs, ours = digest(fresh), digest(place)
        wrong = [path for path in theirs if ours.get(path) != theirs[path]]
        if wrong:
            return Outcome("different", f"{name}: stale or other {', '.join(wrong)}")
        if any(path.startswith(FILES_OF["simulate"]) and path not in reference.content for path in theirs):
            return Outcome("done", f"{name}: the run went on to further trials")
        stale = [
            f"{step} ({path})"
            for step in called
            for path, content in reference.content.items()
            if path.startswith(FILES_OF.get(step, "-")) and theirs.get(path) != content
        ]
        return Outcome("different", f"{name}: called current, {', '.join(stale)}") if stale else Outcome("done", name)
    except Exception as error:
        return Outcome("traceback", f"{name}: {told(error)}")
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def kill(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Kill a command at a random instant, and give it again."""
    what = ("run", "run", "run", "import", "serve", "workers")[number % 6]
    which = "logged" if what == "import" else "simulated"
    text, reference = finished(which, place.parent.parent)
    _write(place, text)
    if what == "serve":
        return _killed_page(place, random)
    if what == "workers":
        return _killed_cluster(place, reference, random)
    name = what
    seconds = reference.seconds if what == "run" else 4.0
    process = _start(name, place)
    time.sleep(random.uniform(0.0, seconds))
    process.kill()
    process.wait()
    return _repeated(place, reference, f"{name} killed", f"{name}", "run")


def clock(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Run while the clock jumps, or on files from another time."""
    name = CLOCKS[number]
    text, reference = finished("simulated", place.parent.parent)
    _write(place, text)
    if name.startswith("files"):
        _command("run", place)
        moment = {"files of the future": 4e9, "files of 1970": 1.0}[name]
        for path in place.rglob("*"):
            os.utime(path, (moment, moment))
        return _repeated(place, reference, name, "run")
    step = {"backwards": -3600.0, "forwards": 86400.0 * 400, "to and fro": 0.0, "still": 0.0}[name]
    shim = place.with_name(f"{place.name}-shim")
    shim.mkdir(exist_ok=True)
    (shim / "sitecustomize.py").write_text(_SHIM.replace("STEP", repr(step)).replace("NAME", repr(name)))
    try:
        return _repeated(place, reference, name, "run", path=str(shim))
    finally:
        shutil.rmtree(shim, ignore_errors=True)


CLOCKS = ("backwards", "forwards", "to and fro", "still", "files of the future", "files of 1970")
_SHIM = """
import time
_time, _calls, _start = time.time, [0], time.time()
def _now():
    _calls[0] += 1
    if NAME == "still":
        return _start
    jump = STEP if NAME != "to and fro" else (7200.0 if _calls[0] % 2 else -7200.0)
    return _time() + jump * (_calls[0] > 20)
time.time = _now
time.time_ns = lambda: int(_now() * 1e9)
"""


def pair(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Two commands on one campaign, a moment apart."""
    text, reference = finished("simulated", place.parent.parent)
    _write(place, text)
    names = (("run", "run"), ("run", "estimate"), ("design", "run"), ("run", "report"))[number % 4]
    processes = [_start(names[0], place)]
    time.sleep(random.choice((0.0, 0.5, random.uniform(0, reference.seconds))))
    processes.append(_start(names[1], place))
    for process in processes:
        output = process.communicate()[0]
        if process.returncode not in FINE_CODES:
            return Outcome(_fault(process.returncode), f"{names}: exit status {process.returncode}: {output[-300:]}")
    return _repeated(place, reference, f"{' and '.join(names)} at once", "run")


def disk(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """A disk that fills up, a limit on the size of files, a folder that cannot be written to."""
    how = ("full", "limit", "read-only")[number % 3]
    text, reference = finished("simulated", place.parent.parent)
    if how == "limit":
        _write(place, text)
        size = random.choice((0, 1000, 20_000, 100_000))
        process = _start("run", place, preexec_fn=partial(resource.setrlimit, resource.RLIMIT_FSIZE, (size, size)))
        return _refused_then_finished(process, place, place, reference, f"files of {size} bytes at most")
    mount = place.with_name(f"{place.name}-disk")
    mount.mkdir(parents=True, exist_ok=True)
    size = random.choice((40, 100, 200, 400)) if how == "full" else 4000
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", str(mount)], capture_output=True
    ).returncode:
        return Outcome("skipped", "this machine mounts nothing")
    try:
        inside = mount / "campaign"
        _write(inside, text)
        if how == "read-only":
            subprocess.run(["mount", "-o", "remount,ro", str(mount)], check=True)
        process = _start("run", inside)
        return _refused_then_finished(process, inside, place, reference, f"a disk of {size} kB, {how}")
    finally:
        subprocess.run(["umount", str(mount)], check=False)
        mount.rmdir()


class Finished:
    """A campaign that has run undisturbed: its folder, what its files hold, and how long a process took."""

    def __init__(self, folder: Path, seconds: float) -> None:
        """Take its digest."""
        self.folder, self.seconds, self.content = folder, seconds, digest(folder)


@cache
def finished(which: str, state: Path) -> tuple[str, Finished]:
    """Return the text of a small campaign and its finished folder, made once for all workers."""
    text = campaign_text(which)
    folder = state / f"finished-{which}-{hashlib.sha256((text + LOG).encode()).hexdigest()[:8]}"
    note = folder / ".seconds"
    if not note.is_file():
        shutil.rmtree(folder, ignore_errors=True)
        _write(folder, text)
        start = time.monotonic()
        process = _start("run", folder)
        output = process.communicate()[0]
        if process.returncode not in (0, 3):
            raise RuntimeError(f"the campaign itself does not run: {output[-1000:]}")
        note.write_text(str(time.monotonic() - start))
    return text, Finished(folder, float(note.read_text()))


def campaign_text(which: str) -> str:
    """Return the smallest campaign there is, simulated or of a log."""
    from tests.campaign.small import SMALL

    text = SMALL
    for old, new in (
        ("chains = 16", "chains = 4"),
        ("warmup = 500", "warmup = 100"),
        ("draws = 1000", "draws = 100"),
        ("particles = 256", "particles = 64"),
    ):
        assert old in text
        text = text.replace(old, new)
    if which == "logged":
        head, _, rest = text.partition("[truth]")
        text = head + rest[rest.index("[estimation]") :] + IMPORT
        text = text.replace("chains = 4", 'chains = 4\ninitial = "measured"')
    return text


def _prior(name: str, upper: float) -> str:
    return f'[prior.{name}]\ndistribution = "uniform"\nlower = 0.0\nupper = {upper}\n'


CHANGES: list[tuple[str, str, str, str]] = [
    ("simulated", "campaign.name", 'name = "small"', 'name = "other"'),
    ("simulated", "campaign.seed", "seed = 3", "seed = 4"),
    ("simulated", "vehicle.thrust_deduction", 'catalogue = "remus100_surge"', 'catalogue = "remus100_surge"\nthrust_deduction = 0.25'),
    ("simulated", "vehicle.fixed", 'catalogue = "remus100_surge"', 'catalogue = "remus100_surge"\nfixed = { X_udot = -2.0 }'),
    ("simulated", "vehicle.trim", 'catalogue = "remus100_surge"', 'catalogue = "remus100_surge"\ntrim = { n = "100 rad/s" }'),
    (
        "simulated",
        "vehicle.published_prior_sd",
        'catalogue = "remus100_surge"',
        'catalogue = "remus100_surge"\npublished_prior_sd = "20 %"',
    ),
    ("simulated", "structure.optional", 'optional = ["X_u"]', "optional = []"),
    ("simulated", "structure.always", 'always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]', 'always = ["X_uabsu", "T_nabsn", "X_u"]'),
    ("simulated", "structure.rules", 'optional = ["X_u"]', 'optional = ["X_u"]\nrules = ["never X_u"]'),
    ("simulated", "structure.shortlist", 'optional = ["X_u"]', 'optional = ["X_u"]\nshortlist = 3'),
    ("simulated", "structure.g", 'optional = ["X_u"]', 'optional = ["X_u"]\ng = "rows"'),
    ("simulated", "prior.lower", "lower = -3.6", "lower = -3.0"),
    ("simulated", "prior.upper", "upper = 12.0e-4", "upper = 11.0e-4"),
    ("simulated", "prior.distribution", '"uniform"\nlower = -8.8\nupper = 0.0', '"normal"\nmean = -3.0\nsd = 1.0'),
    ("simulated", "prior.dissipative", "upper = 1.2", "upper = 1.2\ndissipative = true"),
    ("simulated", "prior.unit", "lower = -3.6\nupper = 1.2", 'lower = -3.6\nupper = 1.2\nunit = "N s/m"'),
    ("simulated", "sensors.noise", 'noise = "0.05 m/s"', 'noise = "0.06 m/s"'),
    ("simulated", "sensors.rate", 'noise = "0.05 m/s"', 'noise = "0.05 m/s"\nrate = "5 1/s"'),
    ("simulated", "sensors.residuals", 'noise = "0.05 m/s"', 'noise = "0.05 m/s"\nresiduals = "heavy"'),
    ("simulated", "sensors.bias", 'noise = "0.05 m/s"', f'noise = "0.05 m/s"\nbias = "shared"\n{_prior("bias_u", 0.1)}'),
    ("simulated", "sensors.lag", 'noise = "0.05 m/s"', f'noise = "0.05 m/s"\nlag = true\n{_prior("lag_u", 1.0)}'),
    ("simulated", "sensors.reference", 'noise = "0.05 m/s"', 'noise = "0.05 m/s"\nreference = "water"'),
    ("simulated", "sensors of another channel", '[sensors.u]', '[sensors.udot]\nnoise = "0.01 m/s^2"\n[sensors.u]'),
    ("simulated", "limits.lower", 'lower = "0 rpm"', 'lower = "100 rpm"'),
    ("simulated", "limits.upper", 'upper = "1500 rpm"', 'upper = "1350 rpm"'),
    ("simulated", "limits.rate", 'upper = "1500 rpm"', 'upper = "1500 rpm"\nrate = "900 rpm/s"'),
    ("simulated", "limits of the motion", "[design]", '[limits.u]\nupper = "2.5 m/s"\n[design]'),
    ("simulated", "design.families", 'control = "n"', 'control = "n"\nfamilies = ["multistep-3211"]'),
    ("simulated", "design.utility", 'control = "n"', 'control = "n"\nutility = "fisher-d"'),
    ("simulated", "design.filter", 'control = "n"', 'control = "n"\nfilter = "extended"'),
    ("simulated", "design.over", 'control = "n"', 'control = "n"\nutility = "fisher-d"\nover = "local"'),
    ("simulated", "design.per", 'control = "n"', 'control = "n"\nper = "second"'),
    ("simulated", "design.turnaround", 'control = "n"', 'control = "n"\nper = "second"\nturnaround = "20 s"'),
    ("simulated", "design.probability", 'control = "n"', 'control = "n"\nprobability = 0.5'),
    ("simulated", "design.trim", 'control = "n"', 'control = "n"\ntrim = "1100 rpm"'),
    ("simulated", "design.duration", 'duration = "30 s"', 'duration = "40 s"'),
    ("simulated", "design.active", 'active = "20 s"', 'active = "15 s"'),
    ("simulated", "design.start", 'active = "20 s"', 'active = "20 s"\nstart = "3 s"'),
    ("simulated", "design.ramp", 'active = "20 s"', 'active = "20 s"\nramp = "0.5 s"'),
    ("simulated", "design.sample_time", 'sample_time = "0.1 s"', 'sample_time = "0.2 s"'),
    ("simulated", "design.amplitude", 'from = "100 rpm"', 'from = "120 rpm"'),
    ("simulated", "design.period", 'to = "20 s", points = 4', 'to = "20 s", points = 5'),
    ("simulated", "design.prediction", "[truth]", '[design.prediction]\nof = "u"\ncontrol = "1300 rpm"\nafter = "10 s"\n[truth]'),
    ("simulated", "power", "[truth]", '[power]\nhotel = "20 W"\npropulsion = "100 W"\nat = "1500 rpm"\n[truth]'),
    ("simulated", "goal.sd", "[truth]", '[goal]\nsd = { X_uabsu = "50 %" }\n[truth]'),
    ("simulated", "goal.trials", "[truth]", "[goal]\ntrials = 2\n[truth]"),
    ("simulated", "truth", "X_uabsu = -2.93", "X_uabsu = -3.5"),
    ("simulated", "filter.process_noise", "[estimation]", '[filter]\nprocess_noise = { u = "0.02 m/s" }\n[estimation]'),
    ("simulated", "estimation.likelihood", "[estimation]", f'{_prior("process_u", 0.1)}[estimation]\nlikelihood = "filter-error"'),
    ("simulated", "estimation.current", "[estimation]", f'{_prior("current", 0.3)}[estimation]\ncurrent = "shared"'),
    ("simulated", "estimation.initial", "chains = 4", 'initial = "measured"\nchains = 4'),
    ("simulated", "estimation.residuals", "chains = 4", 'residuals = "heavy"\nchains = 4'),
    ("simulated", "estimation.sampler", "chains = 4", 'sampler = "metropolis"\nchains = 4'),
    ("simulated", "estimation.chains", "chains = 4", "chains = 5"),
    ("simulated", "estimation.warmup", "warmup = 100", "warmup = 200"),
    ("simulated", "estimation.draws", "draws = 100", "draws = 200"),
    ("simulated", "estimation.thin", "draws = 100", "draws = 100\nthin = 2"),
    ("simulated", "selection.particles", "particles = 64", "particles = 65"),
    ("simulated", "selection.repeats", "repeats = 2", "repeats = 3"),
    ("simulated", "compute.workers", "+", '\n[compute]\nworkers = "local"\n'),
    ("logged", "log changed", "+", "\n# the log has other numbers\n"),
    ("logged", "import.step", '[import]\n', '[import]\nstep = "0.2 s"\n'),
    ("logged", "import.start", '[import]\n', '[import]\nstart = "2 s"\n'),
    ("logged", "import.end", '[import]\n', '[import]\nend = "25 s"\n'),
    ("logged", "import.trim", "[[import.files]]", '[import.trim.1]\nstart = "3 s"\n[[import.files]]'),
    ("logged", "import.split", '[import]\n', '[import]\nsplit = "10 s"\n'),
    ("logged", "import.files.clock", 'path = "run_{run}.csv"', 'path = "run_{run}.csv"\nclock = "even"'),
    ("logged", "import.files.time.unit", 'time = { column = "t", unit = "s" }', 'time = { column = "t", unit = "min" }'),
    ("logged", "import.files.channels.unit", 'column = "speed", unit = "m/s"', 'column = "speed", unit = "knot"'),
    ("logged", "import.files.channels.scale", 'column = "speed", unit = "m/s"', 'column = "speed", unit = "m/s", scale = 1.01'),
    ("logged", "import.files.channels.offset", 'column = "speed", unit = "m/s"', 'column = "speed", unit = "m/s", offset = 0.01'),
    ("logged", "import.files.axes", 'path = "run_{run}.csv"', 'path = "run_{run}.csv"\naxes = "ENU"'),
]  # fmt: skip
"""Campaign, key, text, and what takes its place; "+" for the end of the file."""


def digest(folder: Path) -> dict[str, str]:
    """Hash of what each result holds: variables and attributes of a dataset, values of a JSON file, else bytes."""
    import xarray as xr

    found = {}
    for path in sorted((folder / "results").rglob("*")):
        if not path.is_file() or path.name.startswith("."):
            continue
        name = str(path.relative_to(folder))
        if path.suffix == ".nc":
            with xr.open_dataset(path, engine="h5netcdf") as data:
                data.load()
                parts = [json.dumps({key: str(value) for key, value in data.attrs.items()}, sort_keys=True)]
                parts += [
                    f"{key} {data[key].dims} {data[key].values.tobytes().hex() if data[key].dtype != object else data[key].values.tolist()}"
                    for key in sorted(map(str, data.variables))
                ]
            content = "\n".join(parts)
        elif path.suffix == ".json":
            held = json.loads(path.read_text())
            # An answer names files where they lie; what it says is the same everywhere.
            held = held["answer"] if path.parent.name == "answers" else held
            content = json.dumps(held, sort_keys=True).replace(str(folder), "FOLDER")
        else:
            content = path.read_bytes().hex()
        found[name] = hashlib.sha256(content.encode()).hexdigest()
    return found


def _run_again(place: Path, reference: Finished, watchman: Watchman, what: str) -> Outcome:
    """Ask how the campaign stands, run it and export, in this process; results are those of the reference or are refused."""
    with watchman.on_duty(place.parent) as seen:
        try:
            _standing(place)
            code, text = command("run", "--quiet", str(place))
        except BaseException as error:
            return Outcome("traceback", f"{what}: {told(error)}")
    if seen:
        return Outcome("escape", f"{what}: {'; '.join(seen)}")
    return _compared(place, reference, what, code, text)


def _standing(place: Path) -> tuple[Any, ...]:
    """What the campaign says of its steps; nothing where its file is refused."""
    from seatrial.campaign.workflow.status import standing
    from seatrial.core.errors import InputError

    try:
        return standing(place)
    except InputError:
        return ()


def _repeated(place: Path, reference: Finished, what: str, *names: str, path: str = "") -> Outcome:
    """Give commands in processes of their own, and compare."""
    code, text = 0, ""
    for name in names:
        process = _start(name, place, path=path)
        text = process.communicate()[0]
        code = process.returncode
        if code not in FINE_CODES:
            return Outcome(_fault(code), f"{what}: then {name} ended with {code}: {text[-400:]}")
    return _compared(place, reference, what, code, text)


def _compared(place: Path, reference: Finished, what: str, code: int, text: str) -> Outcome:
    if code == 1:
        return Outcome("traceback", f"{what}: {text[-400:]}")
    if code == 2:
        return Outcome("refused" if "remedy:" in text else "unclear", f"{what}: {text[-400:]}")
    ours = digest(place)
    wrong = [name for name, content in reference.content.items() if ours.get(name) != content]
    left = [
        str(path.relative_to(place))
        for path in place.rglob("*")
        if path.name.endswith(".part") or path.suffix == ".npz"
    ]
    if wrong or left:
        return Outcome(
            "different",
            f"{what}: {', '.join(f'other {name}' for name in wrong)} {', '.join(f'left {name}' for name in left)}",
        )
    return Outcome("done", what)


def _refused_then_finished(
    process: subprocess.Popen, inside: Path, place: Path, reference: Finished, what: str
) -> Outcome:
    """A command that the disk stops says so; on another disk the rest is done."""
    text = process.communicate()[0]
    if process.returncode not in FINE_CODES:
        return Outcome(_fault(process.returncode), f"{what}: exit status {process.returncode}: {text[-400:]}")
    if process.returncode == 2 and "remedy:" not in text:
        return Outcome("unclear", f"{what}: {text[-400:]}")
    if inside != place:
        shutil.copytree(inside, place)
    return _repeated(place, reference, what, "run")


def _killed_page(place: Path, random: Random) -> Outcome:
    """The page's server killed while it answers; another serves the same folder."""
    before = sorted(path.name for path in place.rglob("*"))
    for attempt in range(2):
        process = _start("serve", place, "--port", "0", "--no-browser")
        line, text = "", ""
        assert process.stdout is not None
        while "http://" not in line:
            line = process.stdout.readline()
            text += line
            if not line:
                return Outcome("abort", f"serve did not begin: {text[-300:]}")
        match = re.search(r"http://\S+", line)
        address = match.group().rstrip(",;.") if match else ""
        try:
            if (status := _answered(address)) != 200:
                return Outcome("abort" if status == 0 else "traceback", f"serve answered {status}")
        finally:
            if attempt == 0:
                with contextlib.suppress(OSError):
                    urllib.request.urlopen(address, timeout=random.uniform(0.001, 0.3))
            process.kill()
            process.wait()
    after = sorted(path.name for path in place.rglob("*"))
    return (
        Outcome("done", "serve killed")
        if before == after
        else Outcome("different", f"serve left {set(after) - set(before)}")
    )


def _answered(address: str) -> int:
    """Status of a page, which is told before it listens; 0 where it never answers."""
    for _ in range(240):
        try:
            with urllib.request.urlopen(address, timeout=120) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            return error.code
        except OSError:
            time.sleep(0.25)
    return 0


def _killed_cluster(place: Path, reference: Finished, random: Random) -> Outcome:
    """A worker, the scheduler or the command killed in the midst of work on a cluster; then the work is done here."""
    from distributed import LocalCluster

    victim = random.choice(("worker", "command", "all"))
    made: Any = LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50)
    with made as cluster:
        process = _start("run", place, workers=cluster.scheduler_address)
        time.sleep(random.uniform(2.0, reference.seconds + 10.0))
        if victim == "worker":
            for nanny in cluster.workers.values():
                with contextlib.suppress(ProcessLookupError, AttributeError):
                    os.kill(nanny.pid, signal.SIGKILL)
        elif victim == "command":
            process.kill()
        else:
            cluster.close()
        text = process.communicate()[0]
    if process.returncode not in (*FINE_CODES, -9):
        return Outcome(_fault(process.returncode), f"{victim} killed: exit status {process.returncode}: {text[-400:]}")
    return _repeated(place, reference, f"{victim} of a cluster killed", "run")


def _fault(code: int) -> str:
    return "abort" if code < 0 else "traceback"


def _command(name: str, folder: Path) -> tuple[int, str]:
    code, text = command(name, "--quiet", str(folder))
    return code, text[-600:]


def _start(name: str, folder: Path, *more: str, path: str = "", workers: str = "", **options: Any) -> subprocess.Popen:
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    environment["PYTHONPATH"] = os.pathsep.join(part for part in (path, environment.get("PYTHONPATH", "")) if part)
    environment |= {"SEATRIAL_WORKERS": workers} if workers else {}
    quiet = () if name in ("serve",) else ("--quiet",)
    arguments = [sys.executable, "-m", "seatrial", name, *quiet, str(folder), *more]
    return subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment, **options
    )


def _write(folder: Path, text: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(text)
    if "[import]" in text:
        (folder / "run_1.csv").write_text(LOG)


def _damage(path: Path, how: str, random: Random) -> None:
    data = path.read_bytes()
    match how:
        case "empty":
            path.write_bytes(b"")
        case "half":
            path.write_bytes(data[: len(data) // 2])
        case "flipped" if data:
            at = random.randrange(len(data))
            path.write_bytes(data[:at] + bytes([data[at] ^ 1 << random.randrange(8)]) + data[at + 1 :])
        case "folder":
            path.unlink()
            path.mkdir()
        case "gone":
            path.unlink()
        case _:
            path.write_bytes(random.randbytes(len(data)))
