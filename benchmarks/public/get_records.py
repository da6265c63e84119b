"""Get the public records of the examples and the benchmark: `python -m benchmarks.public.get_records FOLDER [SET ...]`.

Each set names a repository, a commit, a licence and the SHA-256 of every file. The files are taken from that commit by `git`, checked,
and written below FOLDER: compressed, but for NumPy archives. Afterwards: `export SEATRIAL_DATA=FOLDER`.
"""

import argparse
import gzip
import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path, PurePosixPath

from benchmarks.public.set_file import BenchmarkSet, read_set, set_names


def main() -> None:
    """Get the chosen sets, all of them if none is named."""
    parser = argparse.ArgumentParser(description="Get the public records of the examples and the benchmark.")
    parser.add_argument("folder", type=Path, help="where the records go; becomes SEATRIAL_DATA")
    parser.add_argument(
        "sets", nargs="*", help="names of sets, as `python -m benchmarks.public --list` prints them; all if none"
    )
    options = parser.parse_args()
    for name in options.sets or set_names():
        found = read_set(name)
        if found.files:
            print(f"{name}: {found.source['where']}, {found.source['version']}; licence: {found.source['licence']}")
            print(f"  {get(found, options.folder, found.source['where'])} files in {options.folder / name}")


def get(found: BenchmarkSet, folder: Path, repository: str) -> int:
    """Write every file of a set below a folder, and return how many there are.

    Args:
        found: the set.
        folder: where the records go.
        repository: address or path of a git repository that has the set's commit.

    Raises:
        SystemExit: git fails, or the commit has no file of that name with that SHA-256.
    """
    commit = found.source["version"].removeprefix("commit ")
    with tempfile.TemporaryDirectory() as place:
        _git(place, "init", "--quiet")
        _git(place, "remote", "add", "origin", repository)
        _git(place, "config", "remote.origin.promisor", "true")  # contents come with `show`, file by file
        _git(place, "fetch", "--quiet", "--depth=1", "--filter=blob:none", "origin", commit)
        listed = _git(place, "ls-tree", "-r", "-z", "--name-only", commit).decode().split("\0")
        for path, digest in found.files.items():
            same_name = [one for one in listed if PurePosixPath(one).name == PurePosixPath(path).name]
            contents = (_git(place, "show", f"{commit}:{one}") for one in same_name)
            content = next((one for one in contents if hashlib.sha256(one).hexdigest() == digest), None)
            if content is None:
                sys.exit(f"{repository}: {commit} has no {PurePosixPath(path).name} with SHA-256 {digest}")
            _write(folder / path, content)
    return len(found.files)


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npz":
        path.write_bytes(content)
    else:
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(content, mtime=0))


def _git(place: str, *words: str) -> bytes:
    done = subprocess.run(["git", "-C", place, *words], capture_output=True)
    if done.returncode:
        sys.exit(f"git {words[0]}: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout


if __name__ == "__main__":
    main()
