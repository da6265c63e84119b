"""The page of result files: what each holds, with units; the run of the documentation's blocks compares it with real files."""

from pathlib import Path
from typing import NamedTuple

from seatrial.core.dataset_file import open_dataset


class File(NamedTuple):
    """One result file: what makes it, what it is, and its variables (unit, meaning)."""

    command: str
    meaning: str
    variables: dict[str, tuple[str, str]]


SI = "SI, see `unit`"
DESIGN = {
    "family": ("", "shape of the input"),
    "amplitude": ("SI of the control", "change from trim"),
    "period": ("s", "of the shape"),
    "coefficient": ("", "names"),
    "gain": ("nat", "entropy reduction of the coefficients"),
    "worth": ("that of the utility", "what makes a design the best"),
    "peak_speed": ("m/s", "largest magnitude of the first state in the expected motion"),
    "final_sd": ("SI of the coefficient", "predicted standard deviation after the trial"),
    "length": ("s", "time at which the trial is ended"),
    "sd_before": ("SI of the coefficient", "standard deviation before the trial"),
}
FILES: dict[str, File] = {
    "design.nc": File("design", "every design of the sweep", DESIGN),
    "next.nc": File("next", "the same for the next trial, from the posterior", DESIGN),
    "records/RUN.nc": File(
        "simulate, import",
        "one cleaned trial; a channel has its own name; NaN where nothing was measured",
        {
            "time": ("s", "from the start of the trial"),
            "n": ("rad/s", "a control (`role` says so)"),
            "u": ("m/s", "a measurement"),
        },
    ),
    "posterior/LABEL.nc": File(
        "estimate",
        "draws of one structure, and what is said about each parameter",
        {
            "parameter": ("", "names"),
            "unit": ("", "SI unit of each"),
            "label": ("", "LaTeX of each"),
            "draws": (SI, "chain, draw, parameter"),
            "log_density": ("nat", "log posterior density, on the unconstrained vector"),
            "mean": (SI, "posterior mean"),
            "sd": (SI, "standard deviation with all errors"),
            "draws_sd": (SI, "standard deviation of the draws"),
            "origin": ("", "parts of the variance: noise, stated, runs, model"),
            "shares": ("1", "of the variance from noise, stated inputs, differences between runs, and the model"),
            "mode": (SI, "posterior mode"),
            "laplace_sd": (SI, "standard deviation of the normal about the mode"),
            "mcse": (SI, "Monte Carlo standard error of the mean"),
            "r_hat": ("1", "rank R-hat; below 1.01"),
            "ess_bulk": ("1", "effective draws of the mean; above 400"),
            "ess_tail": ("1", "effective draws of the 5 % and 95 % quantiles"),
            "geweke": ("1", "difference of early and late draws over its error"),
            "prior_kind": ("", "distribution"),
            "prior_mean": (SI, "of the prior"),
            "prior_sd": (SI, "of the prior"),
            "prior_lower": (SI, "of the prior"),
            "prior_upper": (SI, "of the prior"),
            "prior_value": (SI, "where the density of the prior is given"),
            "prior_density": ("1 over SI", "that density"),
        },
    ),
    "filter.nc": File(
        "report, run",
        "the square-root UKF along each fitted record",
        {
            "time": ("s", "of each sample"),
            "record": ("", "index of the record"),
            "nis": ("1", "normalised innovation squared"),
            "n_measured": ("1", "channels measured at the sample"),
            "mean": ("SI of the coefficient", "estimate so far"),
            "sd": ("SI of the coefficient", "its standard deviation"),
            "state": ("SI", "estimated state"),
            "innovation": ("SI of the channel", "measured minus predicted"),
            "coefficient": ("", "names"),
            "state_name": ("", "names"),
            "channel": ("", "names"),
        },
    ),
    "predictions.nc": File(
        "report, run",
        "every record beside its prediction by the chosen structure",
        {
            "time": ("s", "of each sample"),
            "record": ("", "index of the record"),
            "channel": ("", "names"),
            "measured": ("SI of the channel", "the record"),
            "mean": ("SI of the channel", "prediction"),
            "motion_sd": ("SI of the channel", "its standard deviation from the coefficients alone"),
            "sd": ("SI of the channel", "that with the noise of the sensor"),
        },
    ),
    "screening.nc": File(
        "select",
        "all structures in closed form",
        {
            "term": ("", "names"),
            "other": ("", "names"),
            "always": ("", "whether a term is in every structure"),
            "inclusion": ("1", "probability of each term"),
            "inclusion_at": ("1", "the same with wider and narrower priors"),
            "inclusion_by_unit_information": ("1", "the same with a prior worth one row"),
            "joint": ("1", "probability that both terms are there"),
            "mean": ("SI of the term", "averaged over the structures"),
            "mean_at": ("SI of the term", "the same with wider and narrower priors"),
            "within": ("SI of the term", "standard deviation within structures"),
            "between": ("SI of the term", "standard deviation between structures"),
            "fit": ("SI of the term", "in the full structure"),
            "fit_sd": ("SI of the term", "its standard deviation"),
            "bias": ("SI of the term", "what noise in the rows does to it"),
            "bias_error": ("SI of the term", "error of that"),
            "member": ("", "which terms each of the likeliest structures has"),
            "probability": ("1", "of each of them"),
            "log_evidence": ("nat", "of each of them"),
            "scale": ("1", "factor on the widths of the priors"),
            "log_bayes_factor": ("nat", "best structure against the runner-up"),
        },
    ),
}
PLAIN = """## Text files

| file | by | what it is |
|---|---|---|
| `design_schedule.csv`, `.json` | design | the best trial as a table of time (s) and control (its unit is in the heading) |
| `proposed_schedule.csv`, `.json` | next | the same for the next trial |
| `known/LABEL.json` | estimate | how well each parameter of a structure is known, and which combinations are |
| `known/LABEL-left-out.json` | run | what the structure may leave out, and what that would do to its coefficients |
| `selection.json` | select | evidence, error and probability of each structure, inclusion of each term, verdicts |
| `contenders.json` | select, run | the best structure beside the runner-up: their motions, and what each design would tell |
| `criteria/LABEL.json` | criteria | information criteria of a structure |
| `cross_validation.json` | crossvalidate | how each structure and model of the error predicts runs left out |
| `summary.json` | run, report | coefficients with mean, sd and unit, verdicts, cautions, alarms, next trial |
| `modes.json`, `all_modes.json` | estimate, select | posterior modes of each structure, from which estimates and evidences begin |
| `mode.json` | estimate --by mode | posterior mode of the most probable structure: value and sd of each parameter, SI, for `priors_from` |
| `mode_predictions.nc` | estimate --by mode | as `predictions.nc`: the held-back records, as that mode predicts them |
| `coefficients.csv` | estimate, run | each parameter of each structure: mean, sd, 95 % interval, mode, health; by `run` its probability |
| `quote.csv` | run, report | the value to quote of each parameter, and the probability of having it |
| `checkpoints/` | long work | what has been done so far; empty once it is done |

In a schedule `f_1_command` is the command of the thrust `f_1_N` by its law, exact at the rows. If no command makes a thrust, the last
line says so: below the jump at the end of a dead zone, or beyond a table.

Beside `results/` lie `campaign.toml`, `report.html` and the pictures that commands name.
"""
EXAMPLES = {"records/RUN.nc": "records/trial.nc", "posterior/LABEL.nc": "posterior/M-0.nc"}
"""Files of the tutorial that stand for many."""
INTRODUCTION = """# Result files

Everything is under `results/` of the campaign's folder: netCDF-4 files that xarray opens, and plain text. Each carries
`seatrial_version`, the number of its `format`, a `key` of everything it depends on, and `sha256_of_content`. A file whose key is
not that of today's campaign is made again when it is needed; a file of another format, or one that was damaged or edited by hand, is
refused.

```python
import xarray as xr

draws = xr.open_dataset("demo/results/posterior/M-0.nc")
print(draws["mean"].sel(parameter="X_uabsu").item() < 0)
```
"""


def page() -> str:
    """Every file and its variables."""
    parts = [INTRODUCTION]
    for name, file in FILES.items():
        parts += [
            f"## `{name}`",
            "",
            f"By `{file.command}`: {file.meaning}.",
            "",
            "| variable | unit | meaning |",
            "|---|---|---|",
        ]
        parts += [f"| `{key}` | {unit} | {meaning} |" for key, (unit, meaning) in file.variables.items()]
        parts.append("")
    return "\n".join([*parts, PLAIN])


def differences(folder: Path) -> list[str]:
    """Variables of a folder of results that are not told here, and those told that its files lack."""
    found = []
    for name, file in FILES.items():
        path = folder / EXAMPLES.get(name, name)
        if not path.exists():
            found.append(f"{name}: no such file")
            continue
        odd = set(open_dataset(path).variables) ^ set(file.variables)
        found += [f"{name}: {sorted(map(str, odd))} in the file or in the page, and not in both"] if odd else []
    return found
