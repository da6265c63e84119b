from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.core.trees import compiled_tree
from seatrial.sampling.tempered_ladder import LadderSettings
from seatrial.sampling.tempered_smc import SMCSettings
from seatrial.selection.agreement import AgreementSettings, agreed_evidence, judge
from seatrial.selection.evidence import Evidence, EvidenceSettings
from seatrial.selection.importance import ImportanceSettings
from tests.selection.targets import far_peaks, linear, one_peak, spike_on_slab
from tests.selection.test_evidence import short_surge

KEY = jax.random.key(1)
SMALL = AgreementSettings(smc=EvidenceSettings(repeats=4, smc=SMCSettings(particles=512)))


def evidences(**given):
    return {name: Evidence(value, error, name, status=status) for name, (value, error, status) in given.items()}


def test_agreement_on_a_known_evidence():
    target, exact = one_peak()
    found = agreed_evidence(target, KEY, settings=SMALL)
    assert found.status == ""
    assert found.diagnostics["checks"] == 1
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.05


def test_second_peak_that_importance_sampling_misses_alarms():
    """Half of Z lies in each peak: the error of importance sampling is log 2 and its own diagnostics are silent."""
    target, exact = far_peaks()
    found = agreed_evidence(target, KEY, settings=SMALL)
    assert found.log_value == pytest.approx(exact - np.log(2), abs=0.05)
    assert "joint errors" in found.status
    assert abs(found.diagnostics["methods"]["smc"]["log_value"] - exact) < 0.5


@pytest.mark.thorough
def test_phase_transition_alarms():
    """All methods agree on the slab, a hundredth of Z: only the cold search meets the spike."""
    target, exact = spike_on_slab()
    found = agreed_evidence(target, KEY, settings=SMALL)
    assert abs(found.log_value - exact) < 4 * found.std_error or "highest peak" in found.status


@pytest.mark.thorough
def test_value_is_the_other_methods_where_importance_sampling_complains():
    target, exact = short_surge()
    found = agreed_evidence(target, KEY)
    assert found.method == "adaptive tempered SMC"
    assert "Pareto k" in found.status
    assert "the value is that of adaptive tempered SMC" in found.status
    assert abs(found.log_value - exact) < 4 * found.std_error


@compiled_tree()
@dataclass(frozen=True)
class Bare:
    """A target that is no posterior: standard normal prior in two dimensions, log L = -x.x / 2, so Z = 1/2."""

    scale: jax.Array
    dim = 2

    def log_prior(self, z):
        return -0.5 * jnp.sum(z * z) - jnp.log(2 * jnp.pi)

    def log_likelihood(self, z):
        return -0.5 * self.scale * jnp.sum(z * z)

    def sample_prior(self, key, n):
        return jax.random.normal(key, (n, 2))


@pytest.mark.thorough
def test_plain_target():
    settings = AgreementSettings(smc=SMALL.smc, ladder=LadderSettings(rungs=9))
    found = agreed_evidence(Bare(jnp.ones(())), KEY, settings=settings)
    assert found.status == ""
    assert set(found.diagnostics["methods"]) == {"smc", "stepping-stone"}
    assert abs(found.log_value - np.log(0.5)) < 4 * found.std_error


@pytest.mark.thorough
def test_bridge_and_laplace_confirm():
    target, exact = linear(2)
    found = agreed_evidence(target, KEY, ("bridge", "laplace", "importance"), AgreementSettings(lookout=False))
    assert found.status == ""
    assert found.diagnostics["checks"] == 2
    assert abs(found.log_value - exact) < 4 * found.std_error


def test_a_method_that_complains_is_reported_and_progress_ends():
    target, _ = linear(2)
    seen = []
    settings = AgreementSettings(ImportanceSettings(2048, 1024), prior_draws=100, lookout=False)
    found = agreed_evidence(
        target, KEY, ("importance", "prior"), settings, lambda done, total: seen.append(done / total)
    )
    assert "Listing 1" in found.status
    assert "no healthy independent method" in found.status
    assert seen == sorted(seen)
    assert seen[-1] == 1


@pytest.mark.parametrize(
    ("given", "chosen", "words"),
    [
        ({"a": (0.0, 0.01, ""), "b": (0.05, 0.01, "")}, "a", ""),
        ({"a": (0.0, 0.05, ""), "b": (0.29, 0.10, "")}, "a", ""),
        ({"a": (0.0, 0.05, ""), "b": (0.36, 0.10, "")}, "a", "+0.36 nats against a, 3 joint errors"),
        ({"a": (0.0, 0.01, "bad"), "b": (0.05, 0.01, "")}, "b", "a complains: bad; the value is that of b"),
        ({"a": (0.0, 0.01, "bad"), "b": (0.05, 0.01, "worse")}, "a", "b complains: worse"),
        ({"a": (0.0, 0.01, ""), "b": (0.5, 0.6, "")}, "a", "checks to 0.60 nats only"),
        ({"a": (0.0, 0.01, ""), "b": (np.nan, 0.1, "")}, "a", "nan nats"),
        ({"importance": (0.0, 0.01, ""), "laplace": (0.0, np.nan, "")}, "importance", "no healthy independent"),
    ],
)
def test_judgement(given, chosen, words):
    found = judge(evidences(**given), {})
    assert found.method == chosen
    assert words in found.status
    assert bool(words) == bool(found.status)


def test_judgement_with_a_failure_and_another_alarm():
    found = judge(evidences(a=(0.0, 0.01, "")), {"b": "no mode"}, ["a higher peak"])
    assert found.status.startswith("a higher peak; b failed: no mode; the value is that of a")


@pytest.mark.parametrize(
    ("methods", "words"),
    [
        (("importance",), "share no code"),
        ((), "share no code"),
        (("importance", "laplace"), "share no code"),
        (("smc", "briddge"), "bridge"),
    ],
)
def test_methods_that_cannot_check_each_other(methods, words):
    with pytest.raises(InputError, match=words):
        agreed_evidence(linear(2)[0], KEY, methods)


def test_every_method_failed():
    dead = Bare(jnp.asarray(jnp.inf))
    with pytest.raises(NumericalError, match="no method gave an evidence"):
        agreed_evidence(dead, KEY, ("smc", "nested"))
