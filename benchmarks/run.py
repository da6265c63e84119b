"""Speed against C and against what people use today: `python benchmarks/run.py` prints one table.

Names choose measurements, or all of a module: `python benchmarks/run.py memory kernels.surge`. `against` chooses those that compare with
other packages. What needs a tool that is missing is left out, with a sentence.

Every measurement runs in a process of its own that is confined to one or two cores before JAX starts, and checks that
all competitors computed the same numbers. Everything is written to outputs/benchmarks.json too.
"""

import json
import os
import platform
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from timing import Ratio, Row
from tools import missing

MEASUREMENTS = {
    "kernels.surge": (1, 2),
    "kernels.sweep": (1, 2),
    "whole_vehicle.speed": (1, 2),
    "whole_vehicle.trajectory": (1,),
    "whole_vehicle.compilation": (1,),
    "peers.filters": (1,),
    "peers.simulation": (1,),
    "samplers.sampling": (1, 2),
    "chains.speed": (1,),
    "first_answer.seconds": (1,),
    "peer_chains.effective": (1,),
    "profiles.seconds": (1,),
    "surge_fits.seconds": (1,),
    "memory.gradients": (1,),
    "sampler_growth.parameters": (1,),
    "sampler_growth.steps": (1,),
    "sampler_growth.chains": (1,),
    "kernels.growth": (1,),
    "filter_growth.seconds": (1,),
    "filter_error.seconds": (1,),
    "subsets.speed": (1, 2),
    "subsets.package": (1,),
    "structure_recovery.recovered": (1,),
    "design_peers.reached": (2,),
    "cluster.scaling": (2,),
    "gpu.speed": (2,),
}
NEEDS = {
    "kernels.surge": ("gcc",),
    "kernels.sweep": ("gcc",),
    "whole_vehicle.speed": ("gcc",),
    "chains.speed": ("gcc",),
    "peers.filters": ("peers",),
    "peer_chains.effective": ("g++", "peers"),
    "profiles.seconds": ("peers",),
    "surge_fits.seconds": ("peers",),
    "subsets.speed": ("gcc",),
    "subsets.package": ("Rscript",),
    "structure_recovery.recovered": ("peers",),
    "design_peers.reached": ("peers",),
}
AGAINST = "against"
PEERS = ("subsets.package", "peers.simulation", *(name for name, needs in NEEDS.items() if "peers" in needs))
"""Measurements against other packages."""
OUTPUT = Path(__file__).parents[1] / "outputs" / "benchmarks.json"


def main() -> None:
    """Run all measurements, or those named on the command line, and print the table."""
    chosen = _chosen(sys.argv[1:])
    lost = {name: missing(NEEDS.get(name, ())) for name in chosen}
    left_out = [f"{name} is left out: {why}" for name, why in lost.items() if why]
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0
    if not available:
        print("This system cannot confine a process to a core: all numbers are for all cores.")
    found = []
    for name in (name for name in chosen if not lost[name]):
        for cores in MEASUREMENTS[name]:
            if cores <= max(available, 1):
                print(f"{name}, {cores} core{'s' * (cores > 1)} ...", file=sys.stderr, flush=True)
                found += _in_process(name, cores)
    rows = [item for item in found if isinstance(item, Row)]
    ratios = [item for item in found if isinstance(item, Ratio)]
    _print(rows, ratios)
    print("", *left_out, sep="\n")
    machine = {
        "processor": _processor(),
        "cores": available,
        "python": platform.python_version(),
        **{name: version(name) for name in ("jax", "numpy", "scipy")},
    }
    OUTPUT.parent.mkdir(exist_ok=True)
    content = {
        "machine": machine,
        "rows": [r._asdict() for r in rows],
        "ratios": [r._asdict() | {"verdict": r.verdict} for r in ratios],
    }
    OUTPUT.write_text(json.dumps(content, indent=1))
    print(f"{machine['processor']}; Python {machine['python']}, JAX {machine['jax']}; written to {OUTPUT}")


def _chosen(names: list[str]) -> list[str]:
    """Measurements by name, by module or by `AGAINST`, all of them where none is named.

    Raises:
        SystemExit: a name that is neither.
    """
    by_name = {known: (known, known.split(".")[0], AGAINST * (known in PEERS)) for known in MEASUREMENTS}
    unknown = [name for name in names if not any(name in one for one in by_name.values())]
    if unknown:
        raise SystemExit(f"benchmarks: no {', '.join(unknown)}; there are {', '.join(MEASUREMENTS)}, and {AGAINST}")
    return [known for known, one in by_name.items() if not names or not set(one).isdisjoint(names)]


def _in_process(name: str, cores: int) -> list[Row | Ratio]:
    """Measure in a fresh process.

    Raises:
        SystemExit: the measurement failed, or its check did.
    """
    done = subprocess.run([sys.executable, __file__, "--worker", name, str(cores)], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"benchmarks: {name} on {cores} core(s) failed")
    return [(Row if kind == "row" else Ratio)(*values) for kind, values in json.loads(done.stdout)]


def _worker(name: str, cores: int) -> None:
    """Confine this process, then import what imports JAX, measure, and print JSON."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "false"
    module, function = name.split(".")
    found = getattr(import_module(module), function)(cores)
    print(json.dumps([("row" if isinstance(item, Row) else "ratio", item) for item in found]))


def _print(rows: list[Row], ratios: list[Ratio]) -> None:
    group, names = "", [f"{r.group.split(',')[0]}: {r.what}" for r in ratios]
    wide = max(map(len, [*names, *(r.what for r in rows)]), default=0)
    for r in rows:
        if r.group != group:
            group = r.group
            print(f"\n{group}\n  {'':{wide}}{'cores':>6}{'median':>11}{'minimum':>11}")
        print(f"  {r.what:{wide}}{r.cores:6}{r.median:11.4g}{r.minimum:11.4g}  {r.unit}")
    print(f"\n{'Ratios of minima':{wide + 2}}{'cores':>6}")
    for name, r in zip(names, ratios, strict=True):
        print(f"  {name:{wide}}{r.cores:6}{r.value:11.4g}  {r.verdict}")


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    names = (
        [line.split(":")[1].strip() for line in info.read_text().splitlines() if "model name" in line]
        if info.exists()
        else []
    )
    return names[0] if names else platform.processor() or platform.machine()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        _worker(sys.argv[2], int(sys.argv[3]))
    else:
        main()
