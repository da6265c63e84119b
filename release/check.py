"""Build wheel and sdist, and try each extra in an environment of its own: `make dist`.

Every environment gets the wheel with one extra, its dependencies as `requirements.lock` has them, hashes included, and a probe that uses
it; without the extra the same probe has to end in an error that names it. The wheel built from the sdist has to be the wheel. The GPU's
libraries are resolved and not downloaded: they are gigabytes.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
PROBES = {
    "": "seatrial --version && seatrial vehicle remus100_surge && seatrial init demo && seatrial prior demo --quiet",
    "ros": "printf '\\211MCAP0\\r\\n' > a.mcap && seatrial inspect a.mcap",
    "ardupilot": "printf '\\0\\006\\012\\044\\030\\036\\100\\0\\375' > a.tlog && seatrial inspect a.tlog",
    "px4": "printf 'ULog\\001\\022\\065\\001' > a.ulg && seatrial inspect a.ulg",
    "parquet": "printf 'PAR1' > a.parquet && seatrial inspect a.parquet",
    "dashboard": "seatrial init demo && timeout 20 seatrial serve demo --port 0 --no-browser",
    "export": "seatrial export remus100_hall_anstee --to fmu",
    "cluster": "seatrial init demo && SEATRIAL_WORKERS=tcp://127.0.0.1:1 seatrial design demo",
}
"""A line of shell for each extra."""
MISSING = 'pip install -e ".[{}]"'


def main() -> int:
    """Build, install, probe; the exit code is the number of failures."""
    shutil.rmtree(DIST, ignore_errors=True)
    run([sys.executable, "-m", "hatchling", "build"], ROOT)
    wheel, sdist = next(DIST.glob("*.whl")), next(DIST.glob("*.tar.gz"))
    failed = 0 if same_from_sdist(wheel, sdist) else 1
    with tempfile.TemporaryDirectory() as folder:
        plain = environment(Path(folder) / "plain", f"{wheel}")
        failed += report("plain", probe(plain, PROBES[""]))
        for extra, line in PROBES.items():
            if not extra:
                continue
            without = probe(plain, line)
            named = MISSING.format(extra) in without.stderr + without.stdout
            print(
                f"{'ok  ' if named else 'FAIL'} without {extra}: the error {'names' if named else 'does not name'} it",
                flush=True,
            )
            own = environment(Path(folder) / extra, f"{wheel}[{extra}]")
            found = probe(own, line)
            usable = MISSING.format(extra) not in found.stderr + found.stdout and "No module" not in found.stderr
            print(f"{'ok  ' if usable else 'FAIL'} with {extra}", flush=True)
            failed += (not named) + (not usable)
            shutil.rmtree(Path(folder) / extra)
        resolved = subprocess.run(
            [plain / "python", "-m", "pip", "install", "--dry-run", "--quiet", f"{wheel}[cuda]"],
            capture_output=True,
            text=True,
        )
        failed += report("cuda, resolved", resolved)
    return failed


def environment(folder: Path, what: str) -> Path:
    """A new environment with the wheel in it; its programs."""
    venv.create(folder, with_pip=True)
    programs = folder / "bin"
    install = [programs / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    (folder / "locked.txt").write_text(locked([*install, "--dry-run"], folder, what))
    run([*install, "--no-deps", "--require-hashes", "--requirement", folder / "locked.txt"], ROOT)
    run([*install, "--no-deps", "--no-index", what], ROOT)
    return programs


def locked(install: list, folder: Path, what: str) -> str:
    """Lines of the lock, hashes included, for all that a wheel with an extra needs; an error where the lock has not the version."""
    blocks = re.split(r"\n(?=\S)", (ROOT / "requirements.lock").read_text().strip())
    (folder / "versions.txt").write_text("".join(f"{block.splitlines()[0].rstrip(chr(92))}\n" for block in blocks))
    report = folder / "report.json"
    run([*install, "--constraint", folder / "versions.txt", "--report", report, what], ROOT)
    needed = {one["metadata"]["name"]: one["metadata"]["version"] for one in json.loads(report.read_text())["install"]}
    wanted = {f"{canonical(name)}=={version}" for name, version in needed.items() if name != "seatrial"}
    found = {block.split()[0]: block for block in blocks if block.split()[0] in wanted}
    if missing := wanted - found.keys():
        raise SystemExit(f"not in requirements.lock: {', '.join(sorted(missing))}; run `make lock`")
    return "\n".join(found.values()) + "\n"


def canonical(name: str) -> str:
    """Name of a package as indexes write it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def probe(programs: Path, line: str) -> subprocess.CompletedProcess[str]:
    """Run a line of shell in an empty folder, with the programs of an environment first."""
    with tempfile.TemporaryDirectory() as folder:
        return subprocess.run(
            ["bash", "-c", f'export PATH="{programs}:$PATH"; {line}'], cwd=folder, capture_output=True, text=True
        )


def report(name: str, done: subprocess.CompletedProcess[str]) -> int:
    """Say how it ended, and count a failure."""
    print(f"{'FAIL' if done.returncode else 'ok  '} {name}", flush=True)
    if done.returncode:
        print(done.stdout[-2000:], done.stderr[-2000:])
    return int(done.returncode != 0)


def same_from_sdist(wheel: Path, sdist: Path) -> bool:
    """Whether the sdist holds all that the wheel needs."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.unpack_archive(sdist, folder, filter="data")
        (source,) = Path(folder).iterdir()
        run([sys.executable, "-m", "hatchling", "build", "--target", "wheel"], source)
        names = [set(zipfile.ZipFile(one).namelist()) for one in (wheel, next((source / "dist").glob("*.whl")))]
    same = names[0] == names[1]
    print(f"{'ok  ' if same else 'FAIL'} the wheel of the sdist has the same {len(names[0])} files", flush=True)
    return same


def run(command: list, folder: Path) -> None:
    """Run a command that must succeed."""
    subprocess.run(list(map(str, command)), cwd=folder, check=True)


if __name__ == "__main__":
    sys.exit(main())
