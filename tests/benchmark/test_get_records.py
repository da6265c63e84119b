"""The records of a set are taken from its commit, checked by their hash, and written as the campaign reads them."""

import hashlib
import subprocess
from dataclasses import replace

import pytest

from benchmarks.public.get_records import get
from benchmarks.public.set_file import check_file, read_set
from tests.benchmark.small_set import write_set

CONTENT = "t,tau_X,u\n0,0,1\n"


def _git(folder, *words):
    who = ("-c", "user.name=nobody", "-c", "user.email=nobody@example.org")
    return subprocess.run(["git", "-C", folder, *who, *words], check=True, capture_output=True, text=True).stdout


def test_files_of_a_commit_are_written_and_a_wrong_hash_is_refused(tmp_path):
    repository = tmp_path / "repository"
    (repository / "deep" / "within").mkdir(parents=True)
    (repository / "deep" / "a.csv").write_text("another file of that name\n")
    (repository / "deep" / "within" / "a.csv").write_text(CONTENT)
    _git(repository, "init", "--quiet")
    _git(repository, "add", ".")
    _git(repository, "commit", "--quiet", "-m", "records")
    commit = _git(repository, "rev-parse", "HEAD").strip()
    found = replace(
        read_set(str(write_set(tmp_path))),
        files={"surge/a.csv": hashlib.sha256(CONTENT.encode()).hexdigest()},
        source={"version": f"commit {commit}"},
    )
    assert get(found, tmp_path / "data", str(repository)) == 1
    assert check_file(found, tmp_path / "data", "surge/a.csv").name == "a.csv.gz"
    with pytest.raises(SystemExit, match=r"has no a\.csv with SHA-256 0"):
        get(replace(found, files={"surge/a.csv": "0" * 64}), tmp_path / "data", str(repository))
