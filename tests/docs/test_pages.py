"""What the README, the citation file and the written reference promise about their own form."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import seatrial

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))

from blocks import read_blocks  # noqa: E402
from generate.reference import PAGES  # noqa: E402
from kept_reference import KEPT  # noqa: E402


def test_the_readme_is_short():
    """At most 120 lines, a picture under 300 kB, and ten lines of Python."""
    readme = ROOT / "README.md"
    assert len(readme.read_text().splitlines()) <= 120
    assert all((ROOT / "docs" / name).stat().st_size < 300_000 for name in ("report.png", "zigzag.png"))
    (python,) = (block for block in read_blocks(readme) if block.language == "python")
    assert len(python.lines) == 10
    own_log = [block for block in read_blocks(readme) if any("--log log_1.csv" in line for line in block.lines)]
    assert len(own_log[0].lines) == 4


@pytest.mark.parametrize("path", [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")], ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    """To a file, or to a page that the build of the documentation generates."""
    links = re.findall(r'\]\((?!https?:)([^)#\s"]+)(?:#[^)\s]*)?\)', path.read_text())
    generated = {(ROOT / "docs" / name).with_suffix(".md") for name in PAGES}
    assert [
        link for link in links if not (path.parent / link).exists() and (path.parent / link).resolve() not in generated
    ] == []


def test_nothing_installs_seatrial_by_its_name():
    """No package index has seatrial, so that whoever took the name there would run code on the user's machine."""
    folders = ("src", "docs", "tests", "studies", "examples", "benchmarks", "release")
    found = (file for name in folders for file in (ROOT / name).rglob("*"))
    files = [*ROOT.glob("*.md"), *(file for file in found if file.suffix in (".py", ".md", ".toml", ".sh"))]
    assert {ROOT / "README.md", ROOT / "src/seatrial/core/errors.py"} <= set(files)
    by_name = re.compile(r"""install (?:-\S+ )*["']?seatrial(?![-\w/.])""")
    assert [file for file in files if by_name.search(file.read_text(errors="ignore"))] == []


@pytest.mark.parametrize("path", [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")], ids=lambda path: path.name)
def test_modules_that_pages_name_exist(path):
    """`seatrial.a.b` is a module or a name of one, and `.c` after it one beside it. Changelog and decisions speak of their day."""
    if path.name == "CHANGELOG.md" or "decisions" in path.parts:
        return
    parent, missing = "", []
    for name in re.findall(r"`(seatrial(?:\.\w+)+|\.\w+)(?:\([^`]*\))?`", path.read_text()):
        whole = parent + name.removeprefix(".") if name.startswith(".") else name
        if not whole.startswith("seatrial"):
            continue
        parent = whole.rpartition(".")[0] + "."
        file = ROOT / "src" / whole.replace(".", "/")
        homes = (file.parent.with_suffix(".py"), file.parent / "__init__.py", file.parent / "__init__.pyi")
        named = any(home.is_file() and re.search(rf"\b{file.name}\b", home.read_text()) for home in homes)
        if not (file.is_dir() or file.with_suffix(".py").is_file() or named):
            missing.append(whole)
    assert missing == []


@pytest.mark.parametrize("name", KEPT)
def test_what_is_kept_of_the_reference_is_as_the_code_has_it(name):
    """`python docs/kept_reference.py` writes it again."""
    assert (ROOT / "docs" / f"{name}.md").read_text() == PAGES[name]()


def test_pages_name_the_paper_that_they_judge():
    title = "Experiment Design, Bayesian Estimation and Model Selection of an Autonomous Underwater Vehicle"
    pages = (
        "README paper docs/validation docs/explanation/paper docs/explanation/evidence_methods docs/dev/paper_verdicts"
    )
    for name in pages.split():
        assert (name, title in " ".join((ROOT / f"{name}.md").read_text().split())) == (name, True)


WRITTEN = [ROOT / "Makefile", ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
STARTED = sorted(
    {
        name
        for path in WRITTEN
        for name in re.findall(r"\bpython (-m (?:studies|benchmarks)[\w.]+|\w+/[\w/]+\.py)", path.read_text())
    }
)
"""Scripts of the pages, from the root of the repository."""
MEASUREMENTS = """
import sys, run
path = list(sys.path)
for one in run.MEASUREMENTS:
    sys.path[:] = path  # each has a process of its own
    module, function = one.split(".")
    getattr(run.import_module(module), function)
"""


def started(clone, *words, within="."):
    """Run Python where only the package is installed; return what went wrong."""
    environment = {**os.environ, "PYTHONPATH": str(clone / "src")}
    run = subprocess.run(
        [sys.executable, *words], cwd=clone / within, env=environment, capture_output=True, text=True, timeout=300
    )
    return run.returncode and run.stderr[-2000:]


def test_every_measurement_of_the_benchmarks_starts(clone):
    assert not started(clone, "-c", MEASUREMENTS, within="benchmarks")


@pytest.mark.proof
@pytest.mark.parametrize("script", STARTED)
def test_every_script_of_the_pages_starts(clone, script):
    """With `--help` if it has options; else it is read up to its main function, without which it would take long."""
    if script.startswith("-m"):
        assert not started(clone, *script.split(), "--help")
        return
    text = (clone / script).read_text()
    if "argparse" in text:
        assert not started(clone, script, "--help")
    elif "__main__" in text:
        code = f"import runpy; runpy.run_path({str(clone / script)!r})"
        assert not started(clone, "-c", code, within=Path(script).parent)
    else:
        compile(text, script, "exec")  # `examples/run_all.py` runs it


def test_messages_of_the_troubleshooting_page_are_those_of_the_code():
    """Every line of a text block, between its ellipses, stands in a string of the package."""
    sources = "\n".join(path.read_text() for path in (ROOT / "src" / "seatrial").rglob("*.py"))
    package = re.sub(r"""["']\n *f?["']""", "", sources)  # strings over several lines are one
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    lines = [
        line
        for block in re.findall(r"^```text\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
        for line in block.splitlines()
    ]
    parts = [part.strip() for line in lines for part in line.split("…")]
    assert [part for part in parts if part not in package] == []


def test_the_citation_has_what_its_format_asks_for_and_is_that_of_the_package():
    text = (ROOT / "CITATION.cff").read_text()
    found = dict(re.findall(r"^([a-z-]+): *(.*)$", text, re.MULTILINE))
    assert {"cff-version", "message", "title", "authors", "abstract", "license", "version"} <= set(found)
    assert found["cff-version"] == "1.2.0"
    assert found["type"] in ("software", "dataset")
    assert found["version"] == seatrial.__version__
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert found["license"] == project["license"]


def test_the_paper_cites_what_its_bibliography_has():
    cited = set(re.findall(r"@([\w-]+)", (ROOT / "paper.md").read_text().split("---", 2)[2]))
    entries = set(re.findall(r"^@\w+\{([\w-]+),", (ROOT / "paper.bib").read_text(), re.MULTILINE))
    assert cited == entries
