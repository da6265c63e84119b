"""Inertia, added mass and drag of shapes with a closed form, and refusals of what is no vehicle."""

from math import atanh, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import quad

import seatrial as st
from seatrial.core.errors import InputError
from seatrial.vehicles.shape import QUALITIES, ellipsoid_added_mass, shape_terms


def shape_of(form, **given):
    return st.priors_from_shape(form, **given).shape


def terms_of(shape, density=1000.0):
    return {one.name: -one.value for one in shape_terms(shape, density)}


def test_sphere():
    found, mass = shape_of("ellipsoid", length=0.6, diameter=0.6, mass=113.0), 1000 * pi / 6 * 0.6**3
    terms = terms_of(found)
    assert found.inertia == pytest.approx([113.0 * 0.4 * 0.3**2] * 3, rel=1e-4)
    for name in ("X_udot", "Y_vdot", "Z_wdot"):
        assert terms[name] == pytest.approx(mass / 2, rel=1e-4)
    assert not {"K_pdot", "M_qdot", "N_rdot"} & {*terms}


@pytest.mark.parametrize("slenderness", [1.5, 4.0, 12.0])
def test_spheroid(slenderness):
    """The factors of Lamb by elementary functions of the eccentricity, as handbooks print them."""
    length, diameter = 2.0, 2.0 / slenderness
    squared = 1 - slenderness**-2
    e = sqrt(squared)
    along = 2 * (1 - squared) / e**3 * (atanh(e) - e)
    across = 1 / squared - (1 - squared) / e**3 * atanh(e)
    turned = e**4 * (across - along) / ((2 - squared) * (2 * squared - (2 - squared) * (across - along)))
    found = shape_of("ellipsoid", length=length, diameter=diameter, mass=1000 * pi / 6 * length * diameter**2)
    terms = terms_of(found)
    assert terms["X_udot"] == pytest.approx(found.mass * along / (2 - along), rel=1e-3)
    assert terms["Y_vdot"] == terms["Z_wdot"] == pytest.approx(found.mass * across / (2 - across), rel=1e-3)
    assert terms["N_rdot"] == pytest.approx(turned * found.inertia[2], rel=1e-3)
    assert found.inertia[2] == pytest.approx(found.mass / 5 * (length**2 + diameter**2) / 4, rel=1e-3)


def test_ellipsoid_by_quadrature():
    half = np.array([0.9, 0.5, 0.2])

    def alpha(axis):
        value, _ = quad(lambda t: 1 / ((half[axis] ** 2 + t) * np.sqrt(np.prod(half**2 + t))), 0, np.inf)
        return half.prod() * value

    found, volume = ellipsoid_added_mass(*2 * half), 4 / 3 * pi * half.prod()
    for axis, name in enumerate("XYZ"):
        assert found[name] == pytest.approx(volume * alpha(axis) / (2 - alpha(axis)), rel=1e-6)
    b, c = half[1] ** 2, half[2] ** 2
    turned = alpha(2) - alpha(1)
    assert found["K"] == pytest.approx(volume / 5 * (b - c) ** 2 * turned / (2 * (b - c) - (b + c) * turned), rel=1e-6)
    # Sections of a long ellipsoid roll as elliptical cylinders, pi/8 (b^2 - c^2)^2; the mean of the fourth power of its height is 8/15.
    assert ellipsoid_added_mass(80.0, 1.0, 0.4)["K"] == pytest.approx(
        pi / 8 * (0.5**2 - 0.2**2) ** 2 * 80 * 8 / 15, rel=2e-3
    )


def test_long_cylinder_is_the_sum_of_its_strips():
    length, radius = 40.0, 0.1
    found = shape_of(
        "torpedo", length=length, diameter=2 * radius, nose=1e-3, tail=1e-3, mass=1000 * pi * radius**2 * length
    )
    terms = terms_of(found)
    strip = 1000 * pi * radius**2
    assert found.volume == pytest.approx(pi * radius**2 * length, rel=1e-3)
    assert terms["Y_vdot"] == pytest.approx(strip * length, rel=2e-3)
    assert terms["M_qdot"] == pytest.approx(strip * length**3 / 12, rel=2e-3)
    assert terms["Z_wabsw"] == pytest.approx(500 * 1.1 * 2 * radius * length, rel=1e-3)
    assert terms["N_rabsr"] == pytest.approx(500 * 1.1 * 2 * radius * length**4 / 32, rel=1e-3)
    assert found.inertia == pytest.approx(
        [found.mass * radius**2 / 2, *2 * [found.mass * (length**2 / 12 + radius**2 / 4)]], rel=1e-3
    )


def test_nose_and_tail():
    """Half an ellipsoid before a cylinder and a parabola behind it; the origin is at their centre of volume."""
    found = shape_of("torpedo", length=2.0, diameter=0.3, nose=0.4, tail=0.6, mass=100.0)
    area = pi * 0.15**2
    parts = {1.0 - 0.4 * 5 / 8: area * 0.4 * 2 / 3, 0.1: area, -0.4 - 0.6 * 5 / 16: area * 0.6 * 8 / 15}
    assert found.volume == pytest.approx(sum(parts.values()), rel=1e-4)
    centre = sum(place * volume for place, volume in parts.items()) / found.volume
    assert found.sections[0][[0, -1]] == pytest.approx([-1.0 - centre, 1.0 - centre], abs=1e-4)
    assert np.ptp(found.sections, axis=1) == pytest.approx([2.0, 0.15, 0.15])


def test_box():
    solid = shape_of("box", length=0.5, beam=0.5, height=0.5, mass=125.0)
    assert solid.inertia == pytest.approx([125.0 * 0.5**2 / 6] * 3)
    terms = terms_of(solid)
    assert terms["X_udot"] == pytest.approx(0.68 * 125.0)
    assert terms["N_rabsr"] == pytest.approx(500 * 1.05 * 0.5**5 / 16)
    frame = terms_of(shape_of("box", length=0.5, beam=0.5, height=0.5, mass=25.0))
    assert frame["X_udot"] == pytest.approx(terms["X_udot"] / 5)
    assert frame["X_uabsu"] == terms["X_uabsu"]
    # A thin plate has nearly the added mass 8/3 a^3 of a disk of its area.
    plate = shape_of("box", length=1.0, beam=1.0, height=1e-3, mass=1.0)
    assert terms_of(plate)["Z_wdot"] == pytest.approx(1000 * 8 / 3 * pi**-1.5, rel=0.06)


def test_all_signs_dissipate_and_priors_have_the_factors():
    found = st.priors_from_shape("box", length=0.457, beam=0.338, height=0.254, mass=11.5, density=1000.0)
    assert {*found.priors} == {
        f"{axis}_{one}"
        for axis, rate in zip("XYZKMN", "uvwpqr", strict=True)
        for one in (f"{rate}dot", rate, f"{rate}abs{rate}")
    }
    assert all(one.bounds[1] == 0 for one in found.priors.values())
    assert found.priors["X_u"].median == pytest.approx(0.1 * found.priors["X_uabsu"].median)
    assert found.priors["Y_vabsv"].factor == QUALITIES["box drag"].factor
    assert found.sources["Y_vabsv"] in repr(found)
    assert "kg m^2/rad" in repr(found)


def test_a_shape_unlike_those_compared_is_in_doubt():
    usual = {"beam": 0.338, "height": 0.254, "mass": 11.5}
    assert st.priors_from_shape("box", length=0.457, **usual).doubt == ""
    assert "is 5.12 times" in repr(st.priors_from_shape("box", length=1.5, beam=0.338, height=0.254, mass=40.0))


@pytest.mark.parametrize(
    ("form", "given", "words"),
    [
        ("torpedo", {"length": 1.6, "diameter": 0.19, "mass": 3.0}, "200 to 3000"),
        ("box", {"length": 457.0, "beam": 338.0, "height": 254.0, "mass": 11.5}, "2.93.e-07 kg/m.3"),
        ("ellipsoid", {"length": 0.1, "diameter": 0.1, "mass": 5.0}, "9549 kg/m.3"),
        ("torpedo", {"length": 1.0, "mass": 5.0}, "beam and height"),
        ("torpedo", {"length": 1.0, "diameter": 0.2, "beam": 0.2, "height": 0.2, "mass": 30.0}, "remove diameter"),
        ("box", {"length": 1.0, "beam": 1.0, "height": 0.5, "nose": 0.1, "mass": 300.0}, "remove nose"),
        ("torpedo", {"length": 1.0, "diameter": 0.5, "mass": 100.0}, "a nose of 0.5 m"),
        ("torpedo", {"length": -1.0, "diameter": 0.5, "mass": 100.0}, "length"),
        ("box", {"length": 1e200, "beam": 1e200, "height": 1e200, "mass": 100.0}, "1000(.|\n)*give the length in m"),
        ("torpedo", {"length": 1e-200, "diameter": 1e-200, "mass": 100.0}, "0.001"),
        ("box", {"length": 1.0, "beam": 1.0, "mass": 300.0}, "add height, in m"),
        ("cube", {"length": 1.0, "mass": 100.0}, "torpedo"),
    ],
)
def test_what_is_no_vehicle_is_refused(form, given, words):
    with pytest.raises(InputError, match=words):
        shape_of(form, **given)


def test_a_mesh_has_the_closed_form_of_its_shape(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    size, mass = np.array([2.0, 0.6, 0.4]), 200.0
    trimesh.creation.box(size).export(tmp_path / "box.stl")
    found = shape_of("ellipsoid", mesh=tmp_path / "box.stl", mass=mass)
    assert found.volume == pytest.approx(size.prod())
    assert found.inertia == pytest.approx(mass / 12 * ((size**2).sum() - size**2))
    assert found.sections[1:, 50] == pytest.approx(size[1:] / 2)
    framed = shape_of("box", mesh=tmp_path / "box.stl", mass=mass)
    assert framed.size == pytest.approx(tuple(size))
    ball = trimesh.creation.icosphere(subdivisions=5)
    ball.apply_scale(size / 2)
    ball.apply_translation([0.3, 0.0, 0.1])
    ball.export(tmp_path / "ellipsoid.STL")
    expected = shape_of("ellipsoid", length=2.0, beam=0.6, height=0.4, mass=mass)
    found = shape_of("ellipsoid", mesh=tmp_path / "ellipsoid.STL", mass=mass)
    assert found.inertia == pytest.approx(expected.inertia, rel=5e-3)
    assert terms_of(found) == pytest.approx(terms_of(expected), rel=0.02)
    (tmp_path / "text.stl").write_text("solid nothing")
    open_box = trimesh.creation.box(size)
    open_box.update_faces(np.arange(len(open_box.faces)) > 1)
    open_box.export(tmp_path / "open.stl")
    ball.apply_scale(1000.0)
    ball.export(tmp_path / "mm.stl")
    (tmp_path / "hull.obj").write_text("v 0 0 0")
    refused = {"text.stl": "no triangles", "open.stl": "holes", "missing.stl": "No such file"}
    for name, words in (refused | {"mm.stl": "the mesh is in m", "hull.obj": "save it as STL"}).items():
        with pytest.raises(InputError, match=words):
            shape_of("ellipsoid", mesh=tmp_path / name, mass=mass)


def test_a_mesh_without_trimesh_names_the_extra(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(InputError, match=r"\.\[mesh\]"):
        shape_of("ellipsoid", mesh=tmp_path / "hull.stl", mass=1.0)
    with pytest.raises(InputError, match="leave the lengths out"):
        shape_of("ellipsoid", mesh=tmp_path / "hull.stl", length=1.0, mass=1.0)
