"""Draw the pictures of the explanations: `seatrial select` and `profile` on a demonstration, then `python docs/method_figures.py DIR`."""

import re
import shutil
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from seatrial.core.dataset_file import open_dataset

DOCS = Path(__file__).parent
PLACE = DOCS / "explanation"
BLUE, GREY = "#2a6f97", "#9aa5b1"
EFFECTIVE_MASS, THRUST, SPEED = 30.48 + 0.93, 0.9, 1.5418615
TRUTH = np.array([-1.21, -2.93, 6.28e-4])
STEP, TRIALS = 0.05, 200


def main() -> None:
    """Write all pictures."""
    plt.rcParams.update({"svg.hashsalt": "seatrial", "svg.fonttype": "none", "font.size": 9, "axes.spines.top": False})
    demo = Path(sys.argv[1])
    posterior = open_dataset(demo / "results" / "posterior" / "M-2.nc").to_xarray()
    ridge(posterior)
    chains(posterior)
    errors()
    memory()
    held_back()
    baselines()
    for name in ("select", "profile"):
        shutil.copy(demo / f"{name}.svg", PLACE / f"{name}.svg")


def ridge(draws) -> None:
    """Draws of linear beside quadratic drag."""
    kept = draws["draws"].stack(all=("chain", "draw"))
    linear, quadratic = (kept.sel(parameter=name).values[::200] for name in ("X_u", "X_uabsu"))
    figure, axes = plt.subplots(figsize=(5.2, 3.2))
    axes.scatter(linear, quadratic, s=5, alpha=0.4, color="#2a6f97", linewidths=0)
    axes.plot(*TRUTH[:2], "k+", markersize=12, label="truth")
    axes.set(xlabel="X_u, kg/s", ylabel="X_uabsu, kg/m")
    axes.legend(frameon=False)
    _save(figure, "ridge")


def errors() -> None:
    """Estimates by regression of the acceleration and by output error, many trials at once."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 60.0, STEP)
    doublets = np.where((time >= 1) & (time < 41), np.where(((time - 1) % 20) < 10, 1.0, -1.0), 0.0)
    control = 125.0 + 20.94 * doublets
    speed, rate = _simulate(TRUTH[:, None], control)
    noise = np.array([0.0, 0.02, 0.05, 0.0757])
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.2), sharey=True)
    for axes, method, title in ((left, "regression", "regression"), (right, "simulation", "output error")):
        for place, sd in enumerate(noise[1:] if method == "simulation" else noise):
            seen = speed + rng.normal(size=(time.size, TRIALS)) * sd
            rates = rate + rng.normal(size=seen.shape) * 0.01
            found = _regress(seen, rates, control) if method == "regression" else _fit(seen, control)
            x = place + (method == "simulation")
            axes.scatter(x + rng.uniform(-0.2, 0.2, TRIALS), found[0], s=4, alpha=0.5, color="#2a6f97", linewidths=0)
        axes.axhline(TRUTH[0], color="black", linewidth=0.8)
        axes.set(
            title=title, xlabel="noise of the speed, m/s", xticks=range(4), xticklabels=[f"{sd:g}" for sd in noise]
        )
    left.set_ylabel("estimate of X_u, kg/s (line: the truth)")
    _save(figure, "errors")


def chains(draws) -> None:
    """Four chains of quadratic drag."""
    figure, axes = plt.subplots(figsize=(5.2, 2.4))
    for line, shade in zip(
        draws["draws"].sel(parameter="X_uabsu").values[:4], ("a9d6e5", "61a5c2", "2a6f97", "013a63"), strict=True
    ):
        axes.plot(line[:300], color=f"#{shade}", linewidth=0.7)
    axes.set(xlabel="draw after warm-up", ylabel="X_uabsu, kg/m")
    _save(figure, "chains")


def memory() -> None:
    """Stated and actual errors of a slope under noise with a memory, by white and by coloured residuals."""
    rng, samples = np.random.default_rng(2), 400
    regressor = np.where(np.arange(samples) % 100 < 50, 1.0, -1.0)
    correlations = np.array([0.0, 0.5, 0.8, 0.9, 0.95])
    scatter, white, coloured, regained = [], [], [], []
    lags = np.abs(np.subtract.outer(np.arange(samples), np.arange(samples)))
    for rho in correlations:
        weights = np.linalg.inv(rho**lags) @ regressor
        noise = rng.normal(size=(TRIALS * 5, samples))
        noise[:, 1:] *= np.sqrt(1 - rho**2)
        for k in range(1, samples):
            noise[:, k] += rho * noise[:, k - 1]
        scatter.append((noise @ regressor / samples).std())
        regained.append((noise @ weights / (regressor @ weights)).std())
        white.append(1 / np.sqrt(samples))
        coloured.append(1 / np.sqrt(regressor @ weights))
    figure, axes = plt.subplots(figsize=(5.2, 2.8))
    axes.plot(correlations, scatter, "o", color="black", label="white residuals: errors made")
    axes.plot(correlations, white, color="black", label="white residuals: ± stated")
    axes.plot(correlations, regained, "o", color=BLUE, label="coloured residuals: errors made")
    axes.plot(correlations, coloured, color=BLUE, label="coloured residuals: ± stated")
    axes.set(
        xlabel="correlation of the noise from one sample to the next", ylabel="error of the coefficient", ylim=(0, None)
    )
    axes.legend(frameon=False)
    _save(figure, "memory")


def held_back() -> None:
    """What bands and coefficients hold when the model is wrong, from the tables of held_back.md."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in _lines("dev/held_back.md") if "% |" in line]
    bands = {row[0]: row[3] for row in rows if row[1] == "white"}
    rows = [row for row in rows if row[1].isdigit()]
    figure, axes = plt.subplots(figsize=(5.2, 3.6))
    place = np.arange(len(rows))[::-1]
    for cells, marker, label in (
        ([bands.get(row[0], "nan") for row in rows], "o", "new samples in their 90 % band"),
        ([row[2] for row in rows], "s", "coefficients within the model's ±"),
        ([row[5] for row in rows], "d", "coefficients within the one ±"),
    ):
        shares = [float(cell.split("%")[0]) for cell in cells]
        axes.plot(
            shares,
            place,
            marker,
            color="black" if marker == "o" else BLUE,
            mfc="none" if marker == "d" else None,
            clip_on=False,
            label=label,
        )
    axes.axvline(90, color=GREY, linewidth=0.8)
    axes.set(yticks=place, yticklabels=[row[0] for row in rows], xlabel="%", ylabel="the model lacks", xlim=(0, 103))
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.3, 1))
    _save(figure, "held-back")


def baselines() -> None:
    """CRPS of every method over that of ours, whole runs of each channel of the benchmark."""
    sets = "\n".join(_lines("dev/benchmark.md")).split("\n### ")[1:]
    ratios: dict[str, list[float]] = {}
    for one in sets:
        rows = [
            [cell.strip() for cell in line.split("|")[1:-1]] for line in one.splitlines() if re.match(r"\| [a-z]", line)
        ]
        scores = {(row[0], row[1]): float(row[2].split(", ")[1]) for row in rows if len(row) == 7 and ", " in row[2]}
        for (method, channel), score in scores.items():
            if method != "ours":
                ratios.setdefault(method, []).append(score / scores["ours", channel])
    figure, axes = plt.subplots(figsize=(5.2, 3.0))
    for place, values in enumerate(ratios.values()):
        axes.plot(np.clip(values, 0.2, 30), np.full(len(values), -place), "|", color=BLUE, markersize=11)
    axes.axvline(1, color="black", linewidth=0.8)
    axes.set(
        xscale="log",
        yticks=-np.arange(len(ratios)),
        yticklabels=list(ratios),
        xlabel="CRPS over that of seatrial (line: equal; right: seatrial is better)",
    )
    _save(figure, "baselines")


def _lines(page: str) -> list[str]:
    return (DOCS / page).read_text(encoding="utf-8").splitlines()


def _simulate(coefficients: np.ndarray, control: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Speed and acceleration of many vehicles in step, shape (samples, vehicles); midpoint rule."""
    linear, quadratic, thrust = coefficients

    def rate(u: np.ndarray, n: float) -> np.ndarray:
        return (linear * u + quadratic * u * abs(u) + THRUST * thrust * n * abs(n)) / EFFECTIVE_MASS

    u = np.full(coefficients.shape[1], SPEED)
    speeds, rates = [], []
    for n in control:
        speeds.append(u)
        rates.append(rate(u, n))
        u = u + STEP * rate(u + STEP / 2 * rates[-1], n)
    return np.array(speeds), np.array(rates)


def _regress(speed: np.ndarray, rate: np.ndarray, control: np.ndarray) -> np.ndarray:
    """Least squares of the force on its terms, at measured speeds; shape (3, trials)."""
    found = []
    for u, a in zip(speed.T, rate.T, strict=True):
        rows = np.column_stack([u, u * abs(u), THRUST * control * abs(control)])
        found.append(np.linalg.lstsq(rows, EFFECTIVE_MASS * a, rcond=None)[0])
    return np.array(found).T


def _fit(speed: np.ndarray, control: np.ndarray) -> np.ndarray:
    """Least squares of the simulated speed, by Gauss-Newton on all trials at once; shape (3, trials)."""
    found = np.repeat(TRUTH[:, None] * 0.9, speed.shape[1], axis=1)
    for _ in range(8):
        now = _simulate(found, control)[0]
        slopes = []
        for i in range(3):
            moved = found.copy()
            moved[i] *= 1 + 1e-5
            slopes.append((_simulate(moved, control)[0] - now) / (moved[i] - found[i]))
        scale = abs(TRUTH)
        jacobian = np.moveaxis(np.array(slopes), 2, 0).transpose(0, 2, 1) * scale
        steps = [
            np.linalg.lstsq(one, rest, rcond=None)[0] * scale
            for one, rest in zip(jacobian, (speed - now).T, strict=True)
        ]
        found = found + np.array(steps).T
    return found


def _save(figure, name: str) -> None:
    figure.tight_layout()
    figure.savefig(PLACE / f"{name}.svg", metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    main()
