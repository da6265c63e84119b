"""The skeletons that docs/dev/map.md offers to be copied keep the promises of their families."""

import importlib.util
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter
from seatrial.logs.formats import registry
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from seatrial.manoeuvres import family as families
from seatrial.manoeuvres.family import Family
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import sample
from tests.estimation_cases import linear_gaussian
from tests.filters.test_linear import CONTROL, MEASUREMENT, SPACE, STEP
from tests.sampling.moments import assert_moments

SKELETONS = Path(__file__).parents[1] / "docs" / "skeletons"


def skeleton(name):
    spec = importlib.util.spec_from_file_location(f"skeleton_{name}", SKELETONS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_filter_is_the_kalman_filter_of_a_linear_system():
    measurement = MEASUREMENT.copy()
    measurement[3, 0] = measurement[7] = np.nan
    found, known = (
        run_filter(method, SPACE, CONTROL, measurement, STEP)
        for method in (skeleton("filter").SkeletonFilter(), ExtendedKalmanFilter())
    )
    np.testing.assert_allclose(found.log_likelihood, known.log_likelihood, rtol=1e-11)
    np.testing.assert_allclose(found.means, known.means, atol=1e-11)
    assert int(found.failures) == 0


def test_sampler_draws_from_a_normal():
    problem = linear_gaussian(2)
    mean, cov = problem.moments
    starts = jax.random.normal(jax.random.key(9), (32, 2))
    settings = ChainSettings(warmup=500, draws=1500)
    draws = sample(skeleton("sampler"), problem.posterior, starts, 0.1 * jnp.eye(2), jax.random.key(3), settings)
    assert_moments(np.asarray(problem.posterior.constrain(jnp.asarray(draws.z))), mean, np.sqrt(np.diag(cov)))


def test_manoeuvre_is_a_triangle(monkeypatch):
    monkeypatch.setitem(families.SHAPES, "triangle", skeleton("manoeuvre").TriangularWave())
    family = Family("n", 80.0, 30.0, 20.0, 0.5, kind="triangle")
    time = family.time()
    expected = np.interp((time - 1.0) % 8.0, [0, 2, 6, 8], [80, 90, 70, 80])
    expected[(time < 1.0) | (time >= 17.0)] = 80.0
    np.testing.assert_allclose(family.signal(10.0, 8.0, time), expected, atol=1e-6)
    assert family.fits(np.array([0.5, 8.0, 21.0])).tolist() == [False, True, False]


def test_reader_gives_what_was_written(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "FORMATS", (skeleton("reader").FORMAT, *registry.FORMATS))
    path = tmp_path / "voyage.pairs"
    path.write_text("#pairs\n" + "".join(f"t={0.1 * k:.1f} surge={k}{' rpm=900' * (k % 2)}\n" for k in range(20)))
    channels = {"u": ColumnMap("surge", "m/s", "measurement"), "n": ColumnMap("rpm", "rpm", "control")}
    table = read_log_table(LogSource(path, None, None, channels))
    np.testing.assert_allclose(table.time, 0.1 * np.arange(20), atol=1e-12)
    np.testing.assert_array_equal(table.columns["u"], np.arange(20.0))
    assert np.isnan(table.columns["n"][::2]).all()


def test_exporter_states_what_it_carries(tmp_path):
    from seatrial.export.write import export_vehicle
    from tests.export.cases import PROVENANCE, rich

    exporter = skeleton("exporter").PlainText()
    statement, (path,) = export_vehicle(exporter, rich(), PROVENANCE, tmp_path)
    assert all(f"# {line}" in path.read_text() for line in statement.lines)


@pytest.mark.parametrize("path", sorted(SKELETONS.glob("*.py")), ids=lambda path: path.stem)
def test_every_skeleton_is_tried_here_and_named_in_the_guide(path):
    assert path.stem in ("filter", "sampler", "manoeuvre", "reader", "exporter")
    assert f"docs/skeletons/{path.name}" in (SKELETONS.parents[1] / "docs" / "dev" / "map.md").read_text()
