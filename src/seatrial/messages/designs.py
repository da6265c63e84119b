"""Results of searches of designs in words: a plan of trials, trials planned together, other sensors, a global search."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from seatrial.core.coefficients import AXES
from seatrial.design.goal_plan import MAX_TRIALS, Stage
from seatrial.design.results import POPULATION
from seatrial.manoeuvres.family import Family, design_words

if TYPE_CHECKING:
    from seatrial.design.batch import PlannedBatch
    from seatrial.design.plan_search import Plan
    from seatrial.design.results import Searched
    from seatrial.design.sensor_choice import SensorComparison


def plan_lines(plan: "Plan") -> list[str]:
    """Return the trials of a plan by stage, the chance that they meet the goals, and the first to drop."""
    if not (plan.steps or plan.ended_by):
        return [f"plan from {plan.basis}: no further trial: the goals are met with chance {plan.chance:.2f}"]
    lines = [f"plan from {plan.basis}: {_count_trials(len(plan.steps))}, {_cost_words(plan.seconds, plan.joules)}"]
    for number, stage in enumerate(plan.stages):
        lines += [_head_of_stage(number, stage)] * (len(plan.stages) > 1)
        lines += [
            f"  {place}. {step.words}; schedule in {step.schedule}"
            for place, step in enumerate(plan.steps, 1)
            if step.stage == number
        ]
    lines.append(f"chance that all goals are met after it: {plan.chance:.2f} ± {plan.chance_error:.2f}")
    lines.append("chance of each goal: " + ", ".join(f"{name} {chance:.2f}" for name, chance in plan.goals.items()))
    if plan.ended_by and plan.further is None:
        reach = f"{MAX_TRIALS} trials of these designs would not reach {plan.asked:g} either"
        lines.append(f"{plan.ended_by}; {reach}. Change goals, sensors or designs")
    elif plan.ended_by and plan.further is not None:
        trials, seconds, joules = plan.further
        lines.append(
            f"{plan.ended_by}; {plan.asked:g} would take {_count_trials(trials)}, {_cost_words(seconds, joules)}"
        )
    if not plan.steps:
        return lines
    at, step = max(enumerate(plan.steps, 1), key=lambda numbered: numbered[1].without)
    name = max(plan.without_goal, key=lambda goal: plan.without_goal[goal])
    return [
        *lines,
        f"if time runs short, drop trial {at} first: the chance is then {step.without:.2f}",
        f"to drop a goal, choose that of {name}: the chance of all others is {plan.without_goal[name]:.2f}",
    ]


def batch_lines(planned: "PlannedBatch") -> list[str]:
    """Return the information of trials that were planned together, and of each with those before it."""
    batch, count = planned.found, len(planned.words)
    together = f"{count} trials together" if count > 1 else "1 trial"
    total, repeated, *reached = (
        f"{value:.2f} {planned.unit}".rstrip() for value in (batch.utility[-1], batch.repeated, *batch.utility)
    )
    return [
        f"{together}: {total}; the best one {count} time{'s' * (count != 1)}: {repeated}",
        *(
            f"{number}. {words}: {worth} so far; schedule in {path}"
            for number, (words, worth, path) in enumerate(
                zip(planned.words, reached, planned.schedules, strict=True), 1
            )
        ),
    ]


def sensor_lines(comparison: "SensorComparison") -> list[str]:
    """Return a table of the best design with other sensors, a row for each."""
    width = max(len(words) for words, _ in comparison.rows)
    columns = [
        f"{f'sd({name})':>{max(14, len(name) + 4)}} {unit}"
        for name, unit in zip(comparison.names, comparison.units, strict=True)
    ]
    lines = [f"{'sensors':<{width}}  {'nat':>6}  {'  '.join(columns)}"]
    meets = comparison.meets or (False,) * len(comparison.rows)
    for (words, worth), is_met in zip(comparison.rows, meets, strict=True):
        values = [f"{sd:>{len(column)}.3g}" for sd, column in zip(worth.sd, columns, strict=True)]
        lines.append(f"{words:<{width}}  {worth.utility:>6.2f}  {'  '.join(values)}{'  meets the goal' * is_met}")
    if comparison.meets and not any(comparison.meets):
        lines.append("none of them meets the goal with this one trial")
    return lines


def search_lines(design: "Searched", family: Family) -> list[str]:
    """Return the best design of a global search and that of the grid; whole populations are evaluated in each family."""
    rest = "" if design.settled else "; the search has not converged: search longer"
    rounded = f" ({design.budget} asked for: whole populations of {POPULATION} in each family)"
    over = f"{design.evaluations} designs{rounded if design.evaluations != design.budget else ''}"
    best, beside = (f"{value:.3f} {design.unit}".rstrip() for value in (design.utility, design.beside))
    return [
        f"global search over {over}: {design_words(family, design.amplitude, design.period)}: "
        f"{best}, the best of the grid ({design.grid}) {beside} by the same measure{rest}",
        *design.safety,
        *(f"{kind}: the search found no design inside the limits" for kind in design.refused),
    ]


def _head_of_stage(number: int, stage: Stage) -> str:
    names = ", ".join(AXES[axis][1].rpartition(" ")[0] for axis in stage.axes)
    keys = [f"moves = {_list(stage.moves)}"]
    keys += [f"measured_inputs = {_list(stage.given)}"] if stage.given else []
    keys += [f"priors_from = {_list([f'../stage_{at + 1}' for at in stage.before])}"] if stage.before else []
    return f"stage {number + 1}, {names}: {', '.join(stage.sought)}; {'; '.join(keys)}"


def _list(words: Sequence[str]) -> str:
    return "[" + ", ".join(f'"{word}"' for word in words) + "]"


def _cost_words(seconds: float, joules: float | None) -> str:
    time = f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"
    return time if joules is None else f"{time} and {joules / 3600:.3g} Wh"


def _count_trials(count: int) -> str:
    return f"{count} trial{'s' * (count != 1)}"
