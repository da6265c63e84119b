"""Run every example and check what it concludes; the checks are loose, the point is that the documented commands work.

Examples on real records need SEATRIAL_DATA; without it they are skipped, and it is said.
"""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parent
OUTPUTS = EXAMPLES.parent / "outputs" / "examples"
FEWER = {"warmup = 2000": "warmup = 500", "draws = 12000": "draws = 1000", "particles = 512": "particles = 128"}
"""Fewer draws of the pool AUV's chains, which may then disagree, and fewer particles: the commands are the point here."""


def main() -> None:
    """Run all examples, in copies under outputs/."""
    subprocess.run([sys.executable, EXAMPLES / "library.py"], check=True)
    subprocess.run([sys.executable, EXAMPLES / "loop_in_ten_lines.py", OUTPUTS / "remus100"], check=True)
    # The command line on what those lines left: nothing is computed again.
    run_campaign("remus100", needs_data=False)
    select_terms("select_surge")
    design_trials("design_trial")
    six_degrees("six_degrees", "make_log.py")
    six_degrees("thruster_rov", "make_bag.py")
    held_back("ship_yaw", 0.9)
    run_campaign("pool_auv", needs_data=True, smaller=FEWER)


def held_back(name: str, least: float) -> None:
    """Judge real records, fit some of them and predict the others, each of which must be explained so well."""
    if not has_data(name):
        return
    folder = OUTPUTS / name
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(EXAMPLES / name / "campaign.toml", folder)
    subprocess.run([sys.executable, "-m", "seatrial", "check", str(folder)], check=True)
    command = [sys.executable, "-m", "seatrial", "estimate", str(folder), "--by", "mode"]
    done = subprocess.run(command, capture_output=True, text=True)
    print(done.stdout, done.stderr, sep="\n", flush=True)
    assert done.returncode in (0, 3), f"example {name}: exit code {done.returncode}"
    shares = [
        float(share) / 100 for share in re.findall(r"held-back run .*?([\d.]+)% of the variance explained", done.stdout)
    ]
    assert len(shares) == 4, shares
    assert min(shares) > least, f"{name}: {shares}"


def six_degrees(name: str, maker: str) -> None:
    """Judge a dive and estimate thirteen unknowns of a whole vehicle from it: each within four standard deviations."""
    folder = OUTPUTS / name
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(EXAMPLES / name / "campaign.toml", folder)
    subprocess.run([sys.executable, EXAMPLES / name / maker, folder], check=True)
    subprocess.run([sys.executable, "-m", "seatrial", "check", str(folder)], check=True)
    command = [sys.executable, "-m", "seatrial", "estimate", str(folder), "--by", "mode"]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    print(told, flush=True)
    rows = re.findall(r"^ +(\S+) +(\S+) ± (\S+)", told, re.MULTILINE)
    found = {coefficient: (mean, sd) for coefficient, mean, sd in rows}
    truth = runpy.run_path(str(EXAMPLES / name / maker))["TRUTH"]
    for coefficient, value in truth.items():
        mean, sd = map(float, found[coefficient])
        assert abs(mean - value) < 4 * sd, f"{coefficient}: {mean} ± {sd}, truth {value}"


def design_trials(name: str) -> None:
    """Design one campaign's trial in families and free of them; what follows, `run`, `next` and `plan`, takes minutes."""
    folder = OUTPUTS / name
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(EXAMPLES / name / "campaign.toml", folder)
    for words in (["design"], ["design", "--free-form", "12"]):
        command = [sys.executable, "-m", "seatrial", words[0], str(folder), *words[1:]]
        code = subprocess.run(command).returncode
        assert code in (0, 3), f"example {name}, {' '.join(words)}: exit code {code}"
    free = json.loads((folder / "results" / "free_form.json").read_text())
    assert free["utility"] > free["beside"]
    assert (folder / "results" / "free_form_schedule.csv").is_file()


def select_terms(name: str) -> None:
    """Screen and select the terms of one campaign from its folder here."""
    folder = OUTPUTS / name
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(EXAMPLES / name / "campaign.toml", folder)
    code = subprocess.run([sys.executable, "-m", "seatrial", "select", str(folder)]).returncode
    assert code in (0, 3), f"example {name} ended with exit code {code}"
    found = json.loads((folder / "results" / "selection.json").read_text())
    assert found["inclusion"]["X_uabsu"] > 0.9
    assert (folder / "select.svg").is_file()


def run_campaign(name: str, needs_data: bool, smaller: dict[str, str] | None = None) -> None:
    """Run one campaign, from its folder here or from the template of that name, and print its verdicts."""
    if needs_data and not has_data(name):
        return
    folder = OUTPUTS / name
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "campaign.toml").exists():
        if (EXAMPLES / name).is_dir():
            text = (EXAMPLES / name / "campaign.toml").read_text(encoding="utf-8")
            for whole, fewer in (smaller or {}).items():
                assert whole in text, f"{name} has no {whole}"
                text = text.replace(whole, fewer)
            (folder / "campaign.toml").write_text(text, encoding="utf-8")
        else:
            subprocess.run([sys.executable, "-m", "seatrial", "init", str(folder), "--template", name], check=True)
    code = subprocess.run([sys.executable, "-m", "seatrial", "run", str(folder)]).returncode
    assert code in (0, 3), f"example {name} ended with exit code {code}"
    summary = json.loads((folder / "results" / "summary.json").read_text())
    assert abs(sum(item["probability"] for item in summary["structures"]) - 1) < 1e-9
    assert (folder / "report.html").stat().st_size < 8_000_000
    print(f"example {name}: {'; '.join(summary['verdicts'])}", flush=True)


def has_data(name: str) -> bool:
    """Whether the real records of an example are there; says so where they are not."""
    if Path(os.environ.get("SEATRIAL_DATA", "missing")).is_dir():
        return True
    print(f"example {name}: skipped, set SEATRIAL_DATA to the folder of real records", flush=True)
    return False


if __name__ == "__main__":
    main()
