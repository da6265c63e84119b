"""Figure 5 is drawn from the posterior that is sampled: another posterior has other nodes."""

import pytest

from seatrial.core.coefficients import CoefficientName
from studies.remus100.model_graph import model_graph
from studies.remus100.panels import printed_unit
from studies.remus100.tests.studies import A
from studies.remus100.trial import paper_posterior, paper_trial, wide


@pytest.fixture(scope="module")
def record():
    return paper_trial(A, None)


def drawn(posterior):
    (axes,) = model_graph(posterior, A.print_scales, {name: printed_unit(A, name) for name in posterior.names}).axes
    return axes


def nodes(axes) -> list[str]:
    return [patch.get_label() for patch in axes.patches]


def words(axes) -> str:
    return " ".join(text.get_text() for text in axes.texts)


def test_nodes_are_the_parameters_their_functions_and_what_is_observed(record):
    axes = drawn(paper_posterior(A, [record], None))
    assert sorted(nodes(axes)) == sorted(
        ["X_u", "X_uabsu", "T_nabsn", "sigma_u", "mean_u: X_u, X_uabsu, T_nabsn", "prec_u: sigma_u", "obs_u"]
    )
    arrows = [text for text in axes.texts if text.get_text() == ""]
    assert len(arrows) == 4 + 2


def test_another_parameter_is_another_node_and_another_term(record):
    axes = drawn(paper_posterior(A, [record], wide(A)))
    assert "X_du3" in nodes(axes)
    assert "mean_u: X_u, X_uabsu, T_nabsn, X_du3" in nodes(axes)
    assert rf"{CoefficientName.parse('X_du3').label}\,\Delta u^3" in words(axes)
    assert "U(−50, 50)" in words(axes)
    assert "U(−50, 50)" not in words(drawn(paper_posterior(A, [record], None)))


def test_priors_are_in_printed_units(record):
    text = words(drawn(paper_posterior(A, [record], None)))
    assert "U(−3.025, 1.815)" in text
    assert "U(−9.42, 15.7)" in text
    assert "[10⁻² N/(rev/s)²]" in text
    assert "U(0, 0.1514)" in text
