"""Files that are sent and fetched, through the whole application but without its pages; and what a hostile log may do."""

import asyncio
import errno
import gzip
import time
import zipfile
from pathlib import Path

import httpx
import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

from fastapi import FastAPI

from seatrial.core.errors import InputError
from seatrial.dashboard import logs as uploads
from seatrial.dashboard.app_context import AppContext
from seatrial.dashboard.campaign_paths import CampaignPaths
from seatrial.dashboard.logs import isolated, look_into
from seatrial.dashboard.pages.work import named_in
from seatrial.dashboard.request_guard import GuardedApp, RequestGuard, token_for
from seatrial.dashboard.server import REPORT_POLICY, _add_files

MOST = 1 << 20
HERE = {"host": "127.0.0.1:8080", "origin": "http://127.0.0.1:8080"}


@pytest.fixture
def ask(tmp_path):
    """Ask an application that serves one campaign."""
    (tmp_path / "served" / "boat").mkdir(parents=True)
    (tmp_path / "served" / "boat" / "campaign.toml").write_text("[campaign]\n")
    (tmp_path / "secret.csv").write_text("secret")
    app, guard = FastAPI(openapi_url=None), RequestGuard("127.0.0.1", None, MOST)
    _add_files(app, AppContext(CampaignPaths.of(tmp_path / "served")), guard)

    def asked(method, path, **more):
        async def answer():
            transport = httpx.ASGITransport(GuardedApp(app, guard))
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8080", headers=HERE) as client:
                return await client.request(method, path, **more)

        return asyncio.run(answer())

    return asked


def files(tmp_path):
    return sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file())


def test_a_log_is_kept_in_its_campaign(ask, tmp_path):
    answer = ask("POST", "/upload/", params={"campaign": "boat", "name": "run.csv"}, content=b"t,u\n0,1\n")
    assert (answer.status_code, answer.json()) == (200, ["kept", "logs/run.csv"])
    assert (tmp_path / "served/boat/logs/run.csv").read_bytes() == b"t,u\n0,1\n"


def test_a_log_of_a_campaign_that_is_not_begun_waits_in_the_served_folder(ask, tmp_path):
    def send(content):
        return ask("POST", "/upload/", params={"campaign": "", "name": "dive.csv"}, content=content).json()

    assert send(b"t,u\n0,1\n") == ["kept", "logs/dive.csv"]
    assert (tmp_path / "served/logs/dive.csv").read_bytes() == b"t,u\n0,1\n"
    said, words = send(b"t,u\n0,2\n")
    assert (said, "a log of that name" in words) == ("refused", True)


def test_a_log_takes_the_place_of_another_only_where_the_campaign_does_not_name_that(ask, tmp_path):
    def send(name, content):
        return ask("POST", "/upload/", params={"campaign": "boat", "name": name}, content=content).json()

    logs, campaign = tmp_path / "served/boat/logs", tmp_path / "served/boat/campaign.toml"
    assert send("run_a.csv", b"t,u\n0,1\n") == ["kept", "logs/run_a.csv"]
    said, words = send("run_a.csv", b"t,u\n0,\xff\x00\n\n")
    assert said == "refused"
    assert words.startswith("run_a.csv")
    assert (logs / "run_a.csv").read_bytes() == b"t,u\n0,1\n"
    assert send("run_a.csv", b"t,u\n0,2\n") == ["replaced", "logs/run_a.csv"]
    assert (logs / "run_a.csv").read_bytes() == b"t,u\n0,2\n"
    for text in (
        '[import]\nfit = ["a"]\n[[import.files]]\npath = "logs/run_{run}.csv"\n',
        '[x]\ny = [{ curve = "./logs/run_a.csv" }]\n',
    ):
        campaign.write_text(text)
        said, words = send("run_a.csv", b"t,u\n0,3\n")
        assert (said, "which the campaign reads" in words) == ("refused", True)
    assert (logs / "run_a.csv").read_bytes() == b"t,u\n0,2\n"
    (logs / "link.csv").symlink_to(tmp_path / "secret.csv")
    assert send("link.csv", b"t,u\n0,3\n")[0] == "refused"
    assert (tmp_path / "secret.csv").read_text() == "secret"


@pytest.mark.parametrize(
    ("campaign", "name", "content", "status"),
    [
        ("boat", "../../evil.csv", b"x", 200),
        ("boat", "%2e%2e%2fevil.csv", b"x", 200),
        ("boat/../..", "evil.csv", b"x", 200),
        ("boat", "a.csv", b"", 200),
        ("boat", "big.csv", b"x" * (MOST + 1), 413),
    ],
)
def test_what_is_odd_is_refused_in_words_and_leaves_nothing(ask, tmp_path, campaign, name, content, status):
    answer = ask("POST", "/upload/", params={"campaign": campaign, "name": name}, content=content)
    assert answer.status_code == status
    assert "Traceback" not in answer.text
    assert status == 413 or answer.json()[0] == "refused"
    assert files(tmp_path) == ["secret.csv", "served/boat/campaign.toml"]


def test_a_full_disk_is_said_in_words(ask, tmp_path, monkeypatch):
    def full(*_args, **_more):
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path))

    monkeypatch.setattr(uploads, "atomic_path", full)
    answer = ask("POST", "/upload/", params={"campaign": "boat", "name": "run.csv"}, content=b"x")
    assert answer.json()[0] == "refused"
    assert "No space left" in answer.text
    assert "free some space" in answer.text


def test_only_results_are_fetched_and_a_report_runs_no_script(ask, tmp_path):
    (tmp_path / "served/boat/report.html").write_text("<script>alert(1)</script>")
    answer = ask("GET", "/download", params={"campaign": "boat", "file": "report.html", "shown": "1"})
    assert answer.status_code == 200
    assert answer.headers["content-security-policy"] == REPORT_POLICY
    assert "script-src" not in REPORT_POLICY
    for campaign, file in (
        ("boat", "../../secret.csv"),
        ("..", "secret.csv"),
        ("boat", "/etc/passwd"),
        ("boat", "results"),
    ):
        answer = ask("GET", "/download", params={"campaign": campaign, "file": file})
        assert answer.status_code == 404
        assert "secret" not in answer.text.replace("secret.csv", "")
    for path in ("/../../secret.csv", "/static/..%2f..%2fsecret.csv", "/docs", "/openapi.json"):
        assert ask("GET", path).status_code == 404


def test_a_question_in_its_own_process_is_kept_small_short_and_worded(in_others):
    assert isolated("x", len, "four") == 4
    with pytest.raises(InputError, match="memory allowed"):
        isolated("x", bytearray, 8 << 30, memory=4 << 30)
    with pytest.raises(InputError, match="not read after"):
        isolated("x", time.sleep, 60.0, seconds=1.0)
    with pytest.raises(InputError, match="16 plain characters"):
        isolated("x", token_for, "0.0.0.0", "short")


@pytest.mark.proof
def test_logs_that_are_none_or_swell_are_refused_in_words(tmp_path, in_others):
    cases = {"noise.mat": b"MATLAB 5.0 MAT-file" + np.random.default_rng(5).bytes(20_000), "line.csv": b"a," * 500_000}
    for name, content in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError) as refused:
            look_into(str(tmp_path / name), name, ())
        assert "Traceback" not in str(refused.value)
    with gzip.open(tmp_path / "swell.csv.gz", "wb") as stream:
        for _ in range(60):
            stream.write(b"0" * (1 << 24))
    with zipfile.ZipFile(tmp_path / "bomb.csv", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", b"0" * (1 << 24))
    for name in ("swell.csv.gz", "bomb.csv"):
        with pytest.raises(InputError) as refused:
            look_into(str(tmp_path / name), name, ())
        assert "remedy" in str(refused.value)


@pytest.mark.parametrize("folder", ["/sea/boat", "/sea/my boat, blue"])
def test_files_that_a_command_names_are_found_whatever_the_folder_is_called(folder):
    output = f"picture: {folder}/prior.svg\nschedule in {folder}/results/design_schedule.csv; /sea/other/prior.svg\n"
    assert named_in(output, Path(folder)) == ["prior.svg", "results/design_schedule.csv"]
