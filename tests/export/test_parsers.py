"""Files of vehicles read by the parsers that the simulators use, where these are installed: nothing in them is unknown or misplaced.

For Gazebo libsdformat (Debian: libsdformat-dev, g++, pkg-config).
"""

import re
import shutil
import subprocess

import pytest

from seatrial.export.targets.gz import Gz
from tests.export.cases import published, rich, written

PARSE = r"""
#include <iostream>
#include <sdf/ParserConfig.hh>
#include <sdf/Root.hh>

int main(int, char** arguments) {
  sdf::ParserConfig strict;
  strict.SetWarningsPolicy(sdf::EnforcementPolicy::ERR);
  strict.SetUnrecognizedElementsPolicy(sdf::EnforcementPolicy::ERR);
  sdf::Root root;
  for (const auto& error : root.Load(arguments[1], strict)) std::cout << error << "\n";
}
"""
VEHICLES = {
    "published": published,
    "rich": rich,
    "ROV": lambda: published("bluerov2_heavy"),
    "Prestero": lambda: published("remus100_prestero"),
}


def library():
    """Name by which pkg-config knows libsdformat, the newest."""
    if not (shutil.which("pkg-config") and shutil.which("g++")):
        return None
    known = subprocess.run(["pkg-config", "--list-all"], capture_output=True, text=True, check=True).stdout
    return max(re.findall(r"^(sdformat\d+)\b", known, re.MULTILINE), key=lambda name: int(name[8:]), default=None)


@pytest.fixture(scope="module")
def parser(tmp_path_factory):
    name = library()
    if name is None:
        pytest.skip("no libsdformat with g++ and pkg-config: SDF is not read by Gazebo's own parser")
    folder = tmp_path_factory.mktemp("parser")
    (folder / "parse.cc").write_text(PARSE)
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", name], capture_output=True, text=True, check=True)
    program = folder / "parse"
    subprocess.run(["g++", "-std=c++17", folder / "parse.cc", "-o", program, *flags.stdout.split()], check=True)
    return program, int(name[8:])


def complaints(parser, path, text):
    path.write_text(text)
    found = subprocess.run([parser, path], capture_output=True, text=True, check=True).stdout
    return [line for line in found.splitlines() if line.strip()]


@pytest.mark.proof
def test_sdf_is_read_without_complaint(parser, tmp_path):
    """Before libsdformat 13 (SDF 1.10) added mass is unknown, and the only thing that is."""
    program, version = parser
    for vehicle in VEHICLES.values():
        for name, text in written(Gz(), vehicle()).items():
            if name.endswith(".sdf"):
                found = complaints(program, tmp_path / name, text)
                assert [line for line in found if version >= 13 or "Element[fluid_added_mass]" not in line] == []
    bad = written(Gz(), published())["model.sdf"].replace("<mass>", "<weight>1</weight><mass>", 1)
    assert any("weight" in line for line in complaints(program, tmp_path / "bad.sdf", bad))
