"""Exports in one call: the catalogue's vehicle, one's own with draws, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

import seatrial as st
from seatrial.vehicles.tether import Tether

VEHICLE = st.load_vehicle("remus100_surge")


def drawn(**means):
    values = np.stack(
        [np.random.default_rng(i).normal(mean, 0.01 * abs(mean), (4, 200)) for i, mean in enumerate(means.values())], -1
    )
    return st.Draws(values, values[..., 0], 0.5, 0, tuple(means), ("1",) * len(means), values)


def test_a_published_vehicle_by_name_and_as_an_object(tmp_path):
    statement, (path,) = st.export_vehicle("remus100_surge", "json", tmp_path / "name")
    _, (other,) = st.export_vehicle(VEHICLE, "json", tmp_path / "object")
    assert any("estimated: nothing" in line for line in statement.lines)
    one, two = (json.loads(file.read_text()) for file in (path, other))
    assert one["coefficients"] == two["coefficients"]


def test_means_of_draws_take_their_places(tmp_path):
    draws = drawn(X_u=-6.0, sigma_u=0.02)
    statement, (path,) = st.export_vehicle(VEHICLE, "json", tmp_path, draws=draws)
    content = json.loads(path.read_text())
    assert f"X_u = {draws['X_u'].mean():.6g}" in "\n".join(statement.lines)
    assert repr(float(draws["X_u"].mean()))[:10] in json.dumps(content)
    assert "-2.93" in json.dumps(content)


@pytest.mark.proof
def test_means_of_a_tether_s_draws_take_their_places_too(tmp_path):
    frame = st.load_vehicle("bluerov2_heavy")
    towed = replace(frame, hull=replace(frame.hull, tether=Tether((-0.2, 0.0, 0.0), 1.0, 2.0)))
    draws = drawn(X_u=-6.0, tether_linear=7.0)
    statement, _ = st.export_vehicle(towed, "csv", tmp_path, draws=draws)
    words = f"tether drag of {draws['tether_linear'].mean():.4g} kg/s and 2 kg/m at (-0.2, 0, 0) m"
    assert f"not supported: {words}" in statement.lines


def test_what_has_no_meaning_is_refused(tmp_path):
    with pytest.raises(st.InputError, match="coefficients of the vehicle: X_u"):
        st.export_vehicle(VEHICLE, "json", tmp_path, draws=drawn(sigma_u=0.1))
    with pytest.raises(st.InputError, match="rest, which has no meaning there"):
        st.export_vehicle(VEHICLE, "json", tmp_path, rest="remus100_prestero")
    with pytest.raises(st.InputError, match="draws, which has no meaning there"):
        st.export_vehicle("remus100_surge", "json", tmp_path, draws=drawn(X_u=-6.0))
    with pytest.raises(st.InputError, match="neither a folder nor a vehicle"):
        st.export_vehicle("remus100_sorge", "json", tmp_path)
    assert not list(tmp_path.iterdir())
