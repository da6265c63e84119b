"""Speed against C and against what people use today: `python benchmarks/run.py` prints one table.

Names choose measurements, or all of a module: `python benchmarks/run.py memory kernels.surge`.

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
from tools import check

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
    "peer_chains.effective": ("g++", "peers"),
    "subsets.speed": ("gcc",),
    "subsets.package": ("Rscript",),
    "structure_recovery.recovered": ("peers",),
    "design_peers.reached": ("peers",),
}
OUTPUT = Path(__file__).parents[1] / "outputs" / "benchmarks.json"


def main() -> None:
    """Run all measurements, or those named on the command line, and print the table."""
    chosen = _chosen(sys.argv[1:])
    check(tool for name in chosen for tool in NEEDS.get(name, ()))
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0
    if not available:
        print("This system cannot confine a process to a core: all numbers are for all cores.")
    found = []
    for name in chosen:
        for cores in MEASUREMENTS[name]:
            if cores <= max(available, 1):
                print(f"{name}, {cores} core{'s' * (cores > 1)} ...", file=sys.stderr, flush=True)
                found += _in_process(name, cores)
    rows = [item for item in found if isinstance(item, Row)]
    ratios = [item for item in found if isinstance(item, Ratio)]
    _print(rows, ratios)
    machine = {
        "processor": _processor(),
        "cores": available,
        "python": platform.python_version(),
        **{name: version(name) for name in ("jax", "numpy", "scipy", "filterpy")},
    }
    OUTPUT.parent.mkdir(exist_ok=True)
    content = {
        "machine": machine,
        "rows": [r._asdict() for r in rows],
        "ratios": [r._asdict() | {"verdict": r.verdict} for r in ratios],
    }
    OUTPUT.write_text(json.dumps(content, indent=1))
    print(f"\n{machine['processor']}; Python {machine['python']}, JAX {machine['jax']}; written to {OUTPUT}")


def _chosen(names: list[str]) -> list[str]:
    """Measurements by name or by module, all of them where none is named.

    Raises:
        SystemExit: a name that is neither.
    """
    unknown = [name for name in names if not any(name in (known, known.split(".")[0]) for known in MEASUREMENTS)]
    if unknown:
        raise SystemExit(f"benchmarks: no {', '.join(unknown)}; there are {', '.join(MEASUREMENTS)}")
    return [known for known in MEASUREMENTS if not names or known in names or known.split(".")[0] in names]


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
    group = ""
    for r in rows:
        if r.group != group:
            group = r.group
            print(f"\n{group}\n  {'':58}{'cores':>6}{'median':>11}{'minimum':>11}")
        print(f"  {r.what:58}{r.cores:6}{r.median:11.4g}{r.minimum:11.4g}  {r.unit}")
    print(f"\nRatios of minima{'':44}{'cores':>6}")
    for r in ratios:
        print(f"  {r.group.split(',')[0] + ': ' + r.what:58}{r.cores:6}{r.value:11.4g}  {r.verdict}")


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
