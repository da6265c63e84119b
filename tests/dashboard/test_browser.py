"""A new user's way through the dashboard in a real browser: no error in its console, no request to anywhere else."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_lock import occupant_of
from tests.campaign.small import NO_X_U, write_small
from tests.campaign.test_vehicle_campaign import log_of
from tests.dashboard.conftest import SLOW
from tests.dashboard.served import served

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")
pytestmark = pytest.mark.proof


def wait_for_end(folder: Path) -> None:
    deadline = time.monotonic() + SLOW / 1000
    while occupant_of(folder) is not None:
        assert time.monotonic() < deadline
        time.sleep(0.2)


def choose(page, field: str, option: str) -> None:
    """Choose an option of a field, both by their words."""
    page.get_by_role("combobox", name=field, exact=True).click()
    page.get_by_role("option", name=option, exact=True).click()
    page.get_by_role("listbox").wait_for(state="detached")


def test_from_a_limit_to_an_export(tmp_path, page):
    folder = write_small(tmp_path / "served" / "boat", *NO_X_U, ("points = 4", "points = 3"))
    with served(tmp_path / "served", kill=True) as (address, _):
        page.goto(address)
        page.locator(".card .links").get_by_role("link", name="Design").click()

        # A limit is refused in words, then edited; the file keeps its comments, and nothing is half written.
        upper = page.get_by_label("n: upper")
        upper.fill("1500 kg")
        page.get_by_role("button", name="Check and save").click()
        page.locator(".q-field--error").get_by_label("n: upper").wait_for()
        assert '"1500 rpm"' in (folder / "campaign.toml").read_text()
        upper.fill("1400 rpm")
        page.get_by_role("button", name="Check and save").click()
        page.get_by_text("Saved in campaign.toml").wait_for()
        assert 'upper = "1400 rpm"' in (folder / "campaign.toml").read_text()

        # The design runs in a process of its own; then its surface can be clicked, or its forms used from the keyboard.
        page.get_by_role("button", name="Run the design").click()
        page.locator(".surface svg").wait_for()
        page.get_by_text("Room inside the limits").wait_for()
        page.get_by_role("combobox", name="Period").click()
        page.get_by_role("option", name="2 s", exact=True).click()
        page.get_by_text("period 2 s", exact=False).first.wait_for()
        with page.expect_download() as download:
            page.get_by_role("button", name="Download its schedule").click()
        assert download.value.path().read_text().startswith("time_s,n_rpm\n0,")

        # A run is stopped and resumed; then the dashboard is killed, which the run does not notice.
        page.get_by_role("navigation").get_by_role("link", name="Run", exact=True).click()
        page.get_by_role("button", name="Start or resume").click()
        page.locator(".bars progress").first.wait_for()
        page.get_by_role("button", name="Stop").click()
        page.get_by_text("interrupted; run the same command again").wait_for()
        page.get_by_role("button", name="Start or resume").click()
        page.locator(".bars progress").first.wait_for()
        there = occupant_of(folder)
        assert there is not None
        assert there.alive
        assert page.said == []
        page.goto("about:blank")
    wait_for_end(folder)
    assert json.loads(Store(folder).summary.read_text())["chosen"] == "M-0"
    shutil.copytree(folder, tmp_path / "served" / "other boat")

    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}run?campaign=boat")
        page.get_by_text("report: ").first.wait_for()
        page.get_by_role("navigation").get_by_role("link", name="Results", exact=True).click()
        for words in ("Values ± standard deviation", "Does it predict?", "Run a repeated doublet"):
            page.get_by_text(words).first.wait_for()
        page.get_by_role("link", name="Zoom into the records").wait_for()
        page.set_viewport_size({"width": 390, "height": 844})
        assert page.locator("table.stacks").count() >= 3
        assert page.evaluate(
            "[...document.querySelectorAll('.scroll:has(.stacks)')].every((one) => one.scrollWidth <= one.clientWidth)"
        )
        page.set_viewport_size({"width": 1000, "height": 900})
        page.get_by_role("navigation").get_by_role("link", name="Compare").click()
        page.get_by_text("difference, joint sd").wait_for()
        assert page.locator("table td").first.inner_text() == "0.0"
        page.set_viewport_size({"width": 390, "height": 844})
        assert page.locator("table.stacks").count() == 3
        assert page.evaluate(
            "[document.documentElement, ...document.querySelectorAll('.scroll')].every((one) => one.scrollWidth <= one.clientWidth)"
        )
        page.set_viewport_size({"width": 1000, "height": 900})
        page.get_by_role("navigation").get_by_role("link", name="Report and export").click()
        with page.expect_popup() as popup:
            page.get_by_role("link", name="Open report.html").click()
        assert popup.value.get_by_text("Does it predict?").first.inner_text()
        popup.value.close()  # menus do not move in a page behind another
        page.get_by_role("combobox", name="Simulator or format").click()
        page.get_by_role("option", name="vehicle: JSON").click()
        page.get_by_role("button", name="Export").click()
        page.locator("main a", has_text="export/json/").first.wait_for()
        page.goto(f"{address}report?campaign=boat")
        page.get_by_text("Not possible for this campaign").wait_for()
        page.get_by_role("combobox", name="Motions not modelled, from").click()
        page.get_by_role("option", name="remus100_hall_anstee").click()
        page.get_by_text("Unsupported terms").wait_for()  # of Gazebo, which is the first that is possible now
        page.get_by_role("combobox", name="Simulator or format").click()
        page.get_by_role("option", name="vehicle: Gazebo").click()
        page.get_by_role("button", name="Export").click()
        page.locator("main a", has_text="export/gz/model.sdf").first.wait_for()
    assert page.said == []
    assert {urlsplit(url).hostname for url in page.asked if not url.startswith(("data:", "blob:", "about:"))} == {
        "127.0.0.1"
    }


def test_a_log_is_sent_mapped_cut_and_checked_by_keyboard(tmp_path, page):
    folder = write_small(tmp_path / "served")
    log = tmp_path / "dive 1.csv"
    rows = [
        f"{0.1 * i:.1f},{1.5 + 0.2 * (i // 50 % 2) + 0.01 * (i * 7 % 5):.3f},{1200 + 200 * (i // 50 % 2)}"
        for i in range(300)
    ]
    log.write_text("time_s,speed,rpm\n" + "\n".join(rows) + "\n")
    with served(folder, "--token", "a token of this test") as (address, _):
        page.goto(f"{address}")
        assert "token" not in page.url
        page.goto(f"{page.url}import?campaign=.")

        # What cannot be read is not kept, and its name stays free; a log that no run reads may be sent again.
        content = log.read_text()
        log.write_bytes(b"\x89\x00\x01 no table\n" * 9)
        page.locator("input[type=file]").set_input_files(log)
        page.get_by_text("The file was not kept.").wait_for()
        assert not (folder / "logs" / "dive 1.csv").exists()
        log.write_text(content)
        page.locator("input[type=file]").set_input_files(log)
        page.get_by_text("Kept as logs/dive 1.csv").wait_for()
        assert page.get_by_role("alert").count() == 0
        page.locator("input[type=file]").set_input_files(log)
        page.get_by_text("Kept as logs/dive 1.csv, instead of the earlier log of that name").wait_for()

        # By form: what is wrong is said in the row, what was typed stays, and nothing is written before it is checked.
        before = (folder / "campaign.toml").read_text()
        unit = page.get_by_label("u: unit")
        unit.fill("kg")
        page.get_by_role("button", name="Check and save this map").click()
        said = page.locator(".channel", has=unit).get_by_role("alert").inner_text()
        assert 'unit "kg"' in said
        assert "campaign.toml" not in said
        assert page.locator(".channel .q-field--error").count() == 1
        assert page.locator(".channel .q-field--error").get_by_label("u: unit").count() == 1
        assert unit.input_value() == "kg"
        assert (folder / "campaign.toml").read_text() == before
        unit.fill("m/s")
        page.locator(".channel .q-field--error").wait_for(state="detached")
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_text("Now import the records: they will be shown above").wait_for()
        assert "# [truth]" in (folder / "campaign.toml").read_text()
        page.reload()
        page.get_by_role("button", name="Check the records").click()
        verdict = page.get_by_text(re.compile("Record dive_1: (pass|caution|alarm)")).first
        verdict.wait_for()
        page.goto(page.url.replace("/import", "/design"))
        page.get_by_role("button", name="Motion under the priors").click()
        page.get_by_text("steady speed at").wait_for()
        page.goto(page.url.replace("/design", "/import"))
        verdict.wait_for()  # although another command was started since
        assert page.get_by_text("steady speed at").count() == 0
        chart = page.locator(".chart")
        chart.locator("svg").wait_for()
        begin, end = page.get_by_label("Begin [s]"), page.get_by_label("End [s]")
        assert float(begin.input_value()) == 0.0
        option = "getElement(+document.querySelector('.chart').id.slice(1)).chart.getOption()"
        for name, ends in (("Zoom in", "25,75"), ("Later", "50,100"), ("Show the whole time", "0,100")):
            page.get_by_role("button", name=name).press("Enter")
            page.wait_for_function(
                f"String({option}.dataZoom.flatMap((one) => [one.start, one.end])) === '{ends},{ends}'"
            )
        page.get_by_role("button", name="Select a range: then drag over the chart").press("Enter")
        box = chart.bounding_box()
        page.mouse.move(box["x"] + 200, box["y"] + 90)
        page.mouse.down()
        page.mouse.move(box["x"] + 500, box["y"] + 90, steps=6)
        page.mouse.up()
        page.wait_for_function("parseFloat(document.querySelector('input[aria-label=\"Begin [s]\"]').value) > 2")
        assert float(end.input_value()) < 29.9
        page.get_by_text("0 to 29.9 s of 29.9 s").wait_for()
        page.get_by_role("button", name="Check, save and re-import").click()
        page.get_by_text("0 to 29.9 s of 29.9 s").wait_for(state="detached")
        page.get_by_text(re.compile(r"samples; [\d.]+ to [\d.]+ s of 29.9 s")).wait_for()
        assert float(begin.input_value()) > 2
        assert "start = " in (folder / "campaign.toml").read_text()
        assert page.get_by_role("button", name="Simulate again").count() == 0
        page.get_by_role("button", name="Re-import", exact=True).wait_for()
    assert page.said == []


def test_two_logs_with_clocks_of_their_own_are_lined_up_before_anything_is_saved(tmp_path, page):
    folder = write_small(tmp_path / "served")
    (folder / "logs").mkdir()
    time = [0.1 * i for i in range(600)]
    level = [(7 * (i // 40) ** 2) % 11 for i in range(600)]
    motor = [f"{t:.1f},{1200 + 20 * one},{one}" for t, one in zip(time, level, strict=True)]
    (folder / "logs" / "motor.csv").write_text("time_s,rpm,yaw_rate\n" + "\n".join(motor) + "\n")
    doppler = [f"{5000 + t:.1f},{1.5 + 0.02 * one},{one}" for t, one in zip(time[100:], level[100:], strict=True)]
    (folder / "logs" / "doppler.csv").write_text("time_s,speed,yaw_rate\n" + "\n".join(doppler) + "\n")
    before = (folder / "campaign.toml").read_text()

    with served(folder) as (address, _):
        page.goto(f"{address}import?campaign=.")
        for log, what in (("logs/doppler.csv", "speed"), ("logs/motor.csv", "rpm")):
            choose(page, "A log in the campaign's folder", log)
            page.get_by_role("button", name="Preview log").click()
            page.get_by_role("combobox", name="n: column" if what == "rpm" else "u: column").wait_for()
        page.get_by_role("button", name="Show before saving").click()
        page.get_by_text("The logs do not overlap").wait_for()
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_text("Nothing was written. The logs do not overlap").wait_for()
        choose(page, "Column of the reference log", "yaw_rate · logs/motor.csv")
        choose(page, "Same quantity in the shifted log", "yaw_rate · logs/doppler.csv")
        page.get_by_role("button", name="Line up by correlation").click()
        page.get_by_text("Correlation 1.000 with logs/doppler.csv shifted by -5000 s").wait_for()
        page.locator('[aria-label="All channels over time"] svg').wait_for()
        shift = page.get_by_label("logs/doppler.csv: shift [s]")
        assert float(shift.input_value()) == -5000
        assert (folder / "campaign.toml").read_text() == before

        shift.fill("-4999.5")
        shift.press("Enter")
        page.get_by_text("doppler.csv: 10.5 s to 60.4 s").wait_for()
        assert page.get_by_text("Correlation 1.000").count() == 0  # it was said of another shift
        shift.fill("-5000")
        shift.press("Enter")
        for wait in range(20, 200, 20):  # a chart may be taken away before the browser has made it
            page.get_by_role("button", name="Show before saving").click()
            page.wait_for_timeout(wait)
        page.get_by_text("Nothing is saved yet").wait_for()
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_text("Now import the records: they will be shown above").wait_for()
        page.get_by_text("Nothing is saved yet").wait_for(state="detached")
        files = tomllib.loads((folder / "campaign.toml").read_text())["import"]["files"]
        assert [file.get("shift") for file in files if file["path"] == "logs/doppler.csv"] == ["-5000 s"]
        page.reload()
        page.get_by_role("button", name="Check the records").click()
        page.get_by_text(re.compile("500 samples over 49.9 s")).first.wait_for(
            state="attached"
        )  # what the command prints is folded
    assert page.said == []


def test_a_column_of_time_is_chosen_and_a_second_run_added(tmp_path, page):
    folder = write_small(tmp_path / "served")
    (folder / "logs").mkdir()
    rows = [f"{100 * i},{1.5 + 0.2 * (i // 50 % 2)},{1200 + 200 * (i // 50 % 2)}" for i in range(300)]
    for run in ("run_a", "run_b"):
        (folder / "logs" / f"{run}.csv").write_text("Zeit,speed,rpm\n" + "\n".join(rows) + "\n")
    before = (folder / "campaign.toml").read_text()

    with served(folder) as (address, _):
        page.goto(f"{address}import?campaign=.")
        choose(page, "A log in the campaign's folder", "logs/run_a.csv")
        page.get_by_role("button", name="Preview log").click()
        time = page.get_by_role("combobox", name="time of run_a.csv: column")
        page.get_by_text("guessed, because it rises in every row, most evenly").first.wait_for()
        choose(page, "time of run_a.csv: column", "choose")
        choose(page, "u: column", "not in a log")
        choose(page, "n: column", "not in a log")
        time.focus()
        for key in ("Enter", "ArrowDown", "Enter"):
            page.keyboard.press(key)
            page.wait_for_timeout(300)
        page.get_by_text("over 29.9 s of Zeit").first.wait_for(state="attached")
        assert time.evaluate("(one) => one === document.activeElement")  # although no channel is mapped yet
        choose(page, "time of run_a.csv: column", "choose")
        page.get_by_text("over rows 1 to 300").first.wait_for(state="attached")
        for channel, column, unit in (("u", "speed", "m/s"), ("n", "rpm", "rpm")):
            choose(page, f"{channel}: column", f"{column} · rows")
            page.get_by_label(f"{channel}: unit").fill(unit)
        assert page.locator(".channel .small-picture", has_text="over rows 1 to 300").locator("path").count() == 2
        choose(page, "n: column", "not in a log")
        choose(page, "time of run_a.csv: column", "Zeit")
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_text("Choose a column: n is an input of the model.").wait_for()
        assert page.locator(".channel .q-field--error").count() == 1
        assert (folder / "campaign.toml").read_text() == before
        choose(page, "time of run_a.csv: column", "choose")
        choose(page, "n: column", "rpm · rows")
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_text("Choose the column of the time stamps, and its unit.").wait_for()
        assert page.locator(".channel .q-field--error").count() == 1
        assert (folder / "campaign.toml").read_text() == before
        choose(page, "time of run_a.csv: column", "Zeit")
        page.locator(".channel").get_by_text("over 29.9 s of Zeit").nth(1).wait_for()
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_text("Now import the records: they will be shown above").wait_for()
        (file,) = tomllib.loads((folder / "campaign.toml").read_text())["import"]["files"]
        assert file["time"] == {"column": "Zeit", "unit": "ms"}

        choose(page, "A log in the campaign's folder", "logs/run_b.csv")
        page.get_by_role("button", name="Preview log").click()
        page.get_by_text("Saving adds run run_b, to fit, with this map. Run run_a keeps its map.").wait_for()
        assert page.get_by_label("Name of the run").input_value() == "run_b"
        page.get_by_role("button", name="Add it, held back to predict").click()
        page.get_by_text("Saved in campaign.toml: run_b is under predict").wait_for()
        imports = tomllib.loads((folder / "campaign.toml").read_text())["import"]
        assert (imports["fit"], imports["predict"]) == (["run_a"], ["run_b"])
        assert [one["path"] for one in imports["files"]] == ["logs/{run}.csv"]
        offered = page.get_by_role("button", name="Import the records")
        assert page.evaluate("document.activeElement.innerText") == "Import the records"
        assert page.locator(".channel").count() == 0  # the form is empty again
        assert page.get_by_role("combobox", name="A log in the campaign's folder").input_value() == ""
        offered.press("Enter")
        page.get_by_text(re.compile("record run_b: 300 samples")).first.wait_for()
        assert offered.count() == 0
        assert page.evaluate("document.activeElement.id") == "main"
    assert page.said == []


def test_from_nothing_to_a_schedule_by_the_page_alone(tmp_path, page):
    root, log = tmp_path / "served", tmp_path / "dive.csv"
    root.mkdir()
    log.write_text(
        "time_s,speed,rpm\n" + "".join(f"{0.1 * i:.1f},{1.5 + 0.001 * i:.3f},{1200 + i}\n" for i in range(300))
    )
    with served(root) as (address, _):
        page.goto(address)
        page.get_by_role("button", name="New campaign").click()
        page.get_by_role("link", name="I plan a trial").click()
        page.get_by_label("Name", exact=True).fill("../boat")
        page.get_by_text("More", exact=True).click()
        noise = page.get_by_label("u: noise", exact=True)
        noise.fill("5 apples")
        page.get_by_role("button", name="Begin", exact=True).click()
        page.get_by_text("Nothing was written").wait_for()
        page.get_by_text("expected letters, digits").wait_for()
        page.get_by_label("Name", exact=True).fill("boat")
        page.get_by_role("button", name="Begin", exact=True).click()
        page.get_by_text('unknown unit "apples"').wait_for()
        assert list(root.iterdir()) == []
        assert noise.input_value() == "5 apples"
        noise.fill("0.05 m/s")
        page.get_by_role("button", name="Show the campaign file").click()
        page.get_by_text("The campaign file can be used").wait_for()
        assert list(root.iterdir()) == []
        page.get_by_role("button", name="Begin", exact=True).click()
        page.wait_for_url("**/design?campaign=boat")
        assert page.get_by_label("n: upper").input_value() == "1600 rpm"
        assert [path.name for path in root.rglob("*")] == ["boat", "campaign.toml"]

        page.get_by_role("button", name="Motion under the priors").click()
        page.get_by_alt_text("prior.svg").wait_for()
        page.get_by_role("button", name="Run the design").click()
        page.locator(".surface svg").wait_for()
        with page.expect_download() as download:
            page.get_by_role("button", name="Download its schedule").click()
        assert download.value.path().read_text().startswith("time_s,n_rpm\n0,1200\n")

        page.get_by_role("navigation").get_by_role("link", name="Records").click()
        page.get_by_text("No record yet: run the designed trial").wait_for()
        page.locator("input[type=file]").set_input_files(log)
        page.locator(".channel").get_by_text("1200 to 1499").wait_for()
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_text("Now import the records: they will be shown above").wait_for()
        assert 'path = "logs/dive.csv"' in (root / "boat" / "campaign.toml").read_text()
        page.goto(address)
        page.locator("li.missing", has_text="import").wait_for()
    assert page.said == []


def test_commands_stand_in_groups(tmp_path, page):
    write_small(tmp_path / "served" / "boat")
    with served(tmp_path / "served") as (address, _):
        page.goto(address)
        page.locator(".card .links").get_by_role("link", name="Run", exact=True).click()
        page.get_by_role("combobox", name="Command", exact=True).click()
        shown = page.get_by_role("listbox").inner_text().splitlines()
        assert (
            shown.index("Before a trial") < shown.index("prior: the speeds that the priors allow") < shown.index("Fit")
        )
        page.get_by_role("option", name="estimate: coefficients of every structure", exact=True).click()
        page.get_by_role("combobox", name="by", exact=True).wait_for()
    assert page.said == []


def test_noise_and_terms_are_chosen_by_keyboard(tmp_path, page):
    folder = write_small(tmp_path / "served" / "boat", ("X_u = -1.21\n", ""))
    before = (folder / "campaign.toml").read_text()

    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}model?campaign=boat")
        noise = page.get_by_role("combobox", name="residuals", exact=True)
        noise.focus()
        page.keyboard.press("Enter")
        page.get_by_role("listbox").wait_for()
        page.keyboard.press("ArrowDown")
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Enter")
        upper = page.get_by_label("tau_u: upper", exact=True)
        upper.wait_for()
        page.get_by_label("optional", exact=True).fill("X_foo")
        page.get_by_label("optional", exact=True).press("Tab")
        page.get_by_text("X_foo").first.wait_for()
        page.get_by_label("optional", exact=True).fill("X_uu")
        page.get_by_label("optional", exact=True).press("Tab")
        unit = page.get_by_label("X_uu: unit", exact=True)
        unit.wait_for()
        assert page.get_by_label("X_u: lower", exact=True).count() == 0
        page.get_by_label("tau_u: upper", exact=True).fill("soon")
        page.get_by_role("button", name="Check and save").press("Enter")
        page.get_by_text("Nothing was written").wait_for()
        assert page.locator(".q-field--error").get_by_label("tau_u: upper", exact=True).count() == 1
        page.get_by_label("tau_u: upper", exact=True).fill("20")
        unit.fill("kg")
        page.get_by_role("button", name="Check and save").press("Enter")
        page.locator(".q-field--error").get_by_label("X_uu: unit", exact=True).wait_for()
        assert (page.get_by_label("tau_u: upper", exact=True).input_value(), unit.input_value()) == ("20", "kg")
        assert (folder / "campaign.toml").read_text() == before
        unit.fill("kg/m")
        page.get_by_role("button", name="Check and save").press("Enter")
        page.get_by_text("Saved in campaign.toml").wait_for()
        page.get_by_text("X_uabsu and X_uu differ only when u changes its sign").wait_for()
        content = tomllib.loads((folder / "campaign.toml").read_text())
        assert content["structure"] == {"always": ["X_uabsu", "T_nabsn"], "optional": ["X_uu"]}
        assert content["estimation"]["residuals"] == "coloured"
        assert content["prior"]["tau_u"]["upper"] == 20
        assert "# [prior.X_u]" in (folder / "campaign.toml").read_text()
    assert page.said == []


def test_a_page_follows_what_a_shell_writes_and_keeps_its_colours(tmp_path, page):
    folder = write_small(tmp_path / "served" / "boat")
    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}design?campaign=boat")
        page.get_by_label("n: upper").wait_for()
        page.get_by_label("Colours").select_option("dark")
        text = (folder / "campaign.toml").read_text()
        (folder / "campaign.toml").write_text(text.replace('"1500 rpm"', '"1450 rpm"'))
        page.wait_for_function("document.querySelector('input[aria-label=\"n: upper\"]')?.value === '1450 rpm'")
        page.get_by_label("n: lower").fill("100 rpm")
        (folder / "campaign.toml").write_text(text)
        time.sleep(3.0)  # a form that somebody fills in is not built again
        assert page.get_by_label("n: lower").input_value() == "100 rpm"
        page.goto(address)
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"
        write_small(tmp_path / "served" / "second boat")
        page.get_by_text("served/second boat").wait_for()
    assert page.said == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_said_in_words(tmp_path, page):
    folder = write_small(tmp_path / "served")
    folder.chmod(0o500)
    with served(folder) as (address, _):
        page.goto(f"{address}run?campaign=.")
        page.get_by_role("button", name="Start or resume").click()
        assert "Permission denied" in page.get_by_role("alert").inner_text()


def test_the_whole_file_is_edited_and_a_mistake_marked(tmp_path, page):
    folder = write_small(tmp_path / "served")
    path = folder / "campaign.toml"
    before, shows = path.read_text(), "(text) => document.querySelector('#main textarea')?.value === text"
    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}file?campaign=.")
        field, save = page.get_by_label("campaign.toml, as TOML"), page.get_by_role("button", name="Check and save")
        assert field.input_value() == before
        field.fill(before.replace("upper = 1.2", "uper = 1.2"))
        save.click()
        assert "prior.X_u.uper" in page.get_by_role("alert").inner_text()
        assert path.read_text() == before
        marked = "(one) => one.value.slice(one.selectionStart, one.selectionEnd)"
        page.wait_for_function("() => getSelection().toString() || document.activeElement.tagName === 'TEXTAREA'")
        assert field.evaluate(marked) == "uper = 1.2"
        page.get_by_role("button", name="Undo my changes").click()
        page.wait_for_function(shows, arg=before)

        field.fill(before.replace("upper = 1.2", "upper = 1.0"))
        save.click()
        page.get_by_text("Saved. Earlier results may be stale").wait_for()
        assert path.read_text() == before.replace("upper = 1.2", "upper = 1.0")
        page.wait_for_timeout(4000)  # the form is built again, as the file has changed
        assert page.get_by_text("Saved. Earlier results may be stale").count() == 1

        # What somebody else writes is shown where nothing was typed; it is never overwritten.
        path.write_text(before)
        page.wait_for_function(shows, arg=before)
        page.get_by_label("campaign.toml, as TOML").fill(before.replace("upper = 1.2", "upper = 1.1"))
        path.write_text(before + "\n# by another hand\n")
        page.get_by_role("button", name="Check and save").click()
        assert "The file was changed after you began" in page.get_by_role("alert").inner_text()
        assert path.read_text().endswith("# by another hand\n")
        page.get_by_role("button", name="Show the difference").click()
        page.get_by_text('"Check and save" writes your text').wait_for()
        shown = page.locator("#main pre").inner_text()
        assert "-# by another hand" in shown
        assert re.search(r"^\+.*upper = 1\.1", shown, re.MULTILINE)
        typed = page.get_by_label("campaign.toml, as TOML")
        assert "upper = 1.1" in typed.input_value()
        typed.fill(typed.input_value() + "\n# by another hand\n")
        page.get_by_role("button", name="Check and save").click()
        page.get_by_text("Saved. Earlier results may be stale").wait_for()
        assert path.read_text() == before.replace("upper = 1.2", "upper = 1.1") + "\n# by another hand\n"

        # A file that is no campaign any more can still be mended here.
        path.write_text(before.replace("[campaign]", "[campaign"))
        page.goto(f"{address}file?campaign=.")
        page.get_by_label("campaign.toml, as TOML").fill(before)
        page.get_by_role("button", name="Check and save").click()
        page.get_by_text("Saved. Earlier results may be stale").wait_for()
    assert page.said == []
    assert path.read_text() == before


def test_hovered_values_are_those_of_the_view_after_a_zoom(tmp_path, page):
    """As far as the mouse rests: what is told is what a chart tells when the mouse comes anew."""
    folder = write_small(tmp_path / "served")
    (folder / "logs").mkdir()
    rows = [f"{0.05 * i:.2f},{1.5 + 0.001 * (i % 997):.4f},{1200 + i % 400}" for i in range(8000)]
    (folder / "logs" / "dive.csv").write_text("time_s,speed,rpm\n" + "\n".join(rows) + "\n")
    with served(folder) as (address, _):
        page.goto(f"{address}import?campaign=.")
        page.get_by_role("combobox", name="A log in the campaign's folder").click()
        page.get_by_role("option", name="logs/dive.csv").click()
        page.get_by_role("button", name="Preview log").click()
        page.get_by_role("button", name="Check and save this map").click()
        page.get_by_role("button", name="Import the records").click()
        page.locator(".chart svg").first.wait_for()
        end = page.get_by_label("End [s]")
        end.fill("900")
        page.get_by_role("button", name="Check, save and re-import").click()
        page.get_by_text("at most 399.95 s: the whole record is 399.95 s long").wait_for()
        assert "[import.trim" not in (folder / "campaign.toml").read_text()

        chart = page.locator(".chart").first
        chart.scroll_into_view_if_needed()
        box = chart.bounding_box()
        at = box["x"] + 0.6 * box["width"], box["y"] + 90
        page.mouse.move(at[0] - 9, at[1])
        page.mouse.move(*at)
        parts = "[...document.querySelectorAll('.chart div')]"
        told = f"{parts}.find((one) => one.innerText?.includes(' s\\n') && one.style.position).innerText"
        page.wait_for_function(told)
        before = page.evaluate(told)
        for _ in range(15):
            page.mouse.wheel(0, -400)
            page.wait_for_timeout(100)
        page.wait_for_timeout(1500)
        after = page.evaluate(told)
        page.mouse.move(at[0] - 60, at[1])
        page.mouse.move(*at)
        page.wait_for_timeout(500)
        assert after == page.evaluate(told)
        assert after != before
    assert page.said == []


def test_what_is_wrong_with_a_new_campaign_stands_beside_its_field(tmp_path, page):
    (tmp_path / "served").mkdir()
    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}new?case=plan")
        page.get_by_label("Name", exact=True).fill("boat")
        page.get_by_label("Mass").wait_for()
        assert page.locator("#main input:visible").count() <= 7
        for field, value, told in (
            ("thrust_deduction", "1", "less than 1"),  # it is folded, and the fold opens
            ("Mass, such as 30 kg", "0 kg", "a number above zero"),
            ("Least propeller speed, n", "1700 rpm", "lower below upper"),
        ):
            form = page.get_by_label(field, exact=True)
            good = form.input_value()
            if not form.is_visible():
                page.get_by_text("More", exact=True).click()
            form.fill(value)
            if field == "thrust_deduction":
                page.get_by_text("More", exact=True).click()
            page.get_by_role("button", name="Show the campaign file").click()
            beside = page.locator(".q-field--error")
            beside.filter(has=page.get_by_label(field, exact=True)).get_by_text(told).wait_for()
            assert beside.count() == 1
            form.fill(good)
            form.blur()
        learn = page.get_by_role("combobox", name="What to learn")
        learn.click()
        page.get_by_role("option", name="X_u: linear damping").click()
        learn.press("Escape")
        page.get_by_role("button", name="Show the campaign file").click()
        page.get_by_text("The campaign file can be used.").wait_for()
        assert tomllib.loads(page.locator("#main pre").inner_text())["structure"].get("optional", []) == []
    assert page.said == []


def test_a_log_begins_a_campaign_by_its_columns(tmp_path, page):
    root, log = tmp_path / "served", tmp_path / "dive 1.csv"
    root.mkdir()
    rows = [f"{0.1 * i:.1f},{1.5 + 0.2 * (i // 50 % 2)},{1200 + 200 * (i // 50 % 2)},{i % 7}" for i in range(300)]
    log.write_text("time_s,speed,rpm,other\n" + "\n".join(rows) + "\n")
    with served(root) as (address, _):
        page.goto(f"{address}new?case=log")
        page.get_by_label("Name", exact=True).fill("boat")
        page.get_by_role("button", name="Begin", exact=True).click()
        page.get_by_text("Choose a log, or send one.").wait_for()
        page.locator("input[type=file]").set_input_files(log)
        page.get_by_label("Mass").fill("45 kg")
        assert page.get_by_label("Log, below").input_value() == "logs/dive 1.csv"
        upper = page.get_by_label("n: upper", exact=True)
        assert upper.input_value() == "1400 rpm"
        choose(page, "Control n: column", "other · rows")
        page.wait_for_function("(field) => field.value === '6 rpm'", arg=upper.element_handle())
        choose(page, "Control n: column", "not in a log")
        page.get_by_role("button", name="Begin", exact=True).click()
        page.get_by_text("Choose a column.").wait_for()
        choose(page, "Control n: column", "rpm · rows")
        unit = page.get_by_label("Measured speed u: unit")
        unit.fill("kg")
        page.get_by_role("button", name="Begin", exact=True).click()
        page.locator(".channel", has=unit).get_by_text('unit "kg"').wait_for()
        assert [one.name for one in root.iterdir()] == ["logs"]
        unit.fill("kn")
        page.get_by_role("button", name="Begin", exact=True).click()
        page.wait_for_url("**/import?campaign=boat")
        page.get_by_text("then import the records").wait_for()
        text = tomllib.loads((root / "boat" / "campaign.toml").read_text())
        assert text["import"]["files"] == [
            {
                "path": "logs/dive 1.csv",
                "time": {"column": "time_s", "unit": "s"},
                "channels": {"u": {"column": "speed", "unit": "kn"}, "n": {"column": "rpm", "unit": "rpm"}},
            }
        ]
        assert (text["vehicle"]["mass"], text["limits"]["n"]["upper"]) == ("45 kg", "1400 rpm")
        assert (root / "boat" / "logs" / "dive 1.csv").read_bytes() == log.read_bytes()
    assert page.said == []


def test_a_bag_of_a_published_vehicle_needs_a_name_and_the_log(tmp_path, page):
    root = tmp_path / "served"
    root.mkdir()
    log_of(root)
    with served(root) as (address, _):
        page.goto(f"{address}new?case=bag")
        page.get_by_label("Name", exact=True).fill("rov")
        log = page.get_by_label("Log, below")
        log.fill("other.csv")
        log.press("Tab")
        page.locator(".q-field--error", has=log).get_by_text("no file").wait_for()
        log.fill("dive.csv")
        log.press("Tab")
        page.get_by_text("f_8 from pwm[7]").wait_for()
        page.get_by_role("button", name="Begin", exact=True).click()
        page.wait_for_url("**/import?campaign=rov")
        made = tomllib.loads((root / "rov" / "campaign.toml").read_text())
        assert (made["vehicle"]["catalogue"], made["campaign"]["name"]) == ("bluerov2_heavy", "rov")
    assert page.said == []


def test_a_posterior_mode_is_shown_by_its_report(tmp_path, page):
    folder = write_small(tmp_path / "served" / "boat", *NO_X_U)
    command = [sys.executable, "-m", "seatrial", "estimate", str(folder), "--by", "mode", "--quiet"]
    assert subprocess.run(command, capture_output=True).returncode == 0
    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}results?campaign=boat")
        assert page.locator("table").count() == 0
        page.get_by_role("button", name="Write the report of the first answer").click()
        page.get_by_text("These are not the values to quote").wait_for()
        assert page.locator("#values tbody tr").count() == 2
        assert page.locator("code", has_text=f"seatrial run {folder}").count() == 1
    assert page.said == []


def test_a_term_is_picked_by_keyboard(tmp_path, page):
    folder = write_small(tmp_path / "served" / "boat", ("X_u = -1.21\n", ""))
    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}model?campaign=boat")
        kind = page.get_by_role("combobox", name="Kind", exact=True)
        kind.focus()
        kind.press("Enter")
        page.keyboard.type("cub")
        page.get_by_role("option", name="cubic damping: X_u3").wait_for()
        page.get_by_role("option", name="cubic damping: X_u3").click()
        page.get_by_role("img", name="Seen from above").wait_for()
        page.get_by_text("Nothing is published of it").wait_for()
        page.get_by_role("button", name="Add, optional").press("Enter")
        page.get_by_text("X_u3 is under optional").wait_for()
        page.wait_for_function("document.activeElement.getAttribute('aria-label') === 'X_u3: lower'")
        page.get_by_role("button", name="Add, always in the model").press("Enter")
        page.get_by_text("X_u3 is in the model already").wait_for()
        page.get_by_label("X_u3: lower").fill("-2")
        page.get_by_role("button", name="Check and save").press("Enter")
        page.get_by_text("Saved in campaign.toml").wait_for()
        content = tomllib.loads((folder / "campaign.toml").read_text())
        assert content["structure"]["optional"] == ["X_u", "X_u3"]
        assert content["prior"]["X_u3"]["lower"] == -2
    assert page.said == []
