"""Values in lines: what a parameter is called that is no coefficient, and where it stands."""

from seatrial.messages.values import other_kinds, value_lines, value_text


def test_what_is_no_coefficient_is_said_to_be_what_it_is():
    assert other_kinds(["sigma_u", "tau_u", "share_u", "u_0[1]", "r_0[2]"]) == "noise and starting values"
    assert (
        other_kinds(["delay", "bias_u", "dead_f", "x_b"]) == "delay, offsets of sensors, thrusters and other unknowns"
    )


def test_coefficients_stand_before_all_else():
    texts = {name: value_text(mean, 0.1, (1.0, "")) for name, mean in (("sigma_u", 0.5), ("X_u", -2.0), ("u_0", 1.5))}
    lines = value_lines(texts, ("X_u",))
    assert [line.split()[0] for line in lines] == ["X_u", "noise", "sigma_u", "u_0"]
    assert lines[1] == "noise and starting values:"
    assert lines[0].index("±") == lines[2].index("±")
    assert value_lines({"X_u": "1"}, ("X_u",)) == ["X_u              1"]


def test_a_value_is_shown_in_its_unit():
    assert value_text(2.0, 0.1, (100.0, "cm/s"), "noise 80 %").split() == ["200", "±", "10", "cm/s", "noise", "80", "%"]
