"""Stored results read by those who have only the folder: typed, without JAX, and each decoded in one place."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from seatrial import plot
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.store.results import Results
from seatrial.campaign.store.stored_result import Store, stamp_of, write_stamped_json
from seatrial.campaign.workflow.steps import LOOP, STEPS, Workflow
from seatrial.core.errors import InputError
from tests.campaign.small import write_small, write_summary


def test_reading_imports_neither_jax_nor_xarray(finished):
    folder, _ = finished
    script = (
        "import sys; from pathlib import Path; from seatrial.campaign.store.results import Results\n"
        "from seatrial.dashboard.result_plots import estimated\n"
        f"found = Results(Path({str(folder)!r}))\n"
        "label = found.summary().chosen\n"
        "found.design(), found.next_design(), found.record('trial'), found.screening(), found.contenders(), found.filter()\n"
        "found.posterior(label).own_values, found.known(label)\n"
        "found.predictions(), found.selection()\n"
        f"estimated((Path({str(folder)!r}, 'results', 'posterior', label + '.nc'),))\n"
        "print({'jax', 'xarray'} & {*sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_an_outcome_prints_its_answer_and_each_picture_takes_it(finished):
    _, outcome = finished
    said = repr(outcome)
    assert all(f"\n{name} " in said for name in outcome.chosen.names)
    assert all(verdict in said for verdict in outcome.selection.verdicts)
    assert said.endswith(f"Next: {outcome.summary.next_trial.words}")
    assert outcome._repr_html_().count("<table") == 2
    names = list(outcome.chosen.names)
    for draw, axes in ((plot.fit, 2), (plot.residuals, 2), (plot.posteriors, len(names)), (plot.traces, len(names))):
        assert draw(outcome).shape == (axes,)
    assert plot.pairs(outcome, names[:2]).shape == (2, 2)
    assert plot.entropy_surface(outcome).get_ylabel() == "amplitude [rpm]"
    assert plot.inclusion(outcome).get_xlabel() == "probability that it is needed"


def test_what_is_read_is_what_was_found(finished):
    folder, outcome = finished
    results = Results(folder)
    summary, selection, posterior = (
        results.summary(),
        results.selection(),
        results.posterior(outcome.chosen.structure.label),
    )
    assert [row.mean for row in summary.coefficients] == [row.mean for row in outcome.summary.coefficients]
    assert summary.known == outcome.known
    assert summary.fits == outcome.fits == results.predictions().fits
    assert summary.structures == selection.rows
    assert [one.log_evidence for one in summary.structures] == [one.log_value for one in outcome.selection.evidences]
    assert set(posterior.structure.terms) == set(outcome.chosen.structure.terms)
    np.testing.assert_array_equal(posterior.draws(), outcome.chosen.draws())
    swept, best = results.next_design(), outcome.next.best
    np.testing.assert_array_equal(swept.gain[swept.families.index(best.family.kind)], best.gain)
    assert swept.trim == best.trim


def test_a_result_of_other_fields_says_so(tmp_path):
    write_summary(tmp_path)
    content = json.loads(Store(tmp_path).summary.read_text())
    del content["chosen"], content["sha256_of_content"]
    write_stamped_json(Store(tmp_path).summary, content, "key")
    with pytest.raises(InputError, match=r"(?s)other fields \(ValueError: chosen: Field required\).*run `seatrial run"):
        Results(tmp_path).summary()


def test_every_step_of_the_loop_is_current_after_it(finished):
    folder, _ = finished
    flow = Workflow(load_campaign(folder))
    assert {step.name: flow.state(step.name) for step in LOOP} == {step.name: "current" for step in LOOP}
    for step in LOOP:
        for one in flow.stored(step.name):
            assert stamp_of(one.path) == one.key
            assert one.path in set(Store(folder).results.glob(step.files))


def test_a_key_holds_the_keys_of_all_that_the_step_needs(finished):
    """With records or posteriors of another key, every result that needs them has another key."""
    folder, _ = finished

    def keys(**others):
        flow = Workflow(load_campaign(folder), method="mh", replicates=20, parameters=[], from_time=None, block=None)
        flow.seen("candidates"), flow.seen("selection")  # which are not current once the key of the records is another
        for name, change in others.items():
            flow._seen[name] = change(flow.seen(name))
        names = [name for name, step in STEPS.items() if others.keys() & {*step.needs} and step.files]
        return {(name, one.path.name): one.key for name in names for one in flow.stored(name)}

    def other(one):
        return replace(one, key=one.key + "'")

    changes = {
        "trials": other,
        "chosen": other,
        "full": other,
        "estimates": lambda found: [other(one) for one in found],
    }
    for name, change in changes.items():
        same, changed = keys(**{name: lambda one: one}), keys(**{name: change})
        assert same.keys() == changed.keys() != set()
        assert [place for place in same if same[place] == changed[place]] == []


def test_another_seed_is_another_design(tmp_path):
    """Draws of the priors judge designs, and random steps are drawn by it."""
    first, second = (load_campaign(write_small(tmp_path / seed, ("seed = 3", f"seed = {seed}"))) for seed in "34")
    for name in ("design", "relay", "searched", "measures", "free_form"):
        ours, theirs = (Workflow(one, levels=4, budget=64, designs=5).stored(name)[0].key for one in (first, second))
        assert ours != theirs, name


def test_steps_need_only_steps_before_them_and_settings():
    known = {"campaign", "reporter"}
    settings = {
        "levels",
        "budget",
        "designs",
        "together",
        "vehicles",
        "so_far",
        "parameters",
        "from_time",
        "block",
        "replicates",
        "method",
    }
    for step in STEPS.values():
        assert set(step.needs) <= known | settings, step.name
        known.add(step.name)


def test_every_step_has_its_work_and_what_it_stores_a_name():
    for step in STEPS.values():
        assert (step.work.stored is not None) == bool(step.files), step.name
