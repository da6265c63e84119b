"""Which axes are sought together, and in which order."""

from seatrial.design.goal_plan import find_stages


def stages(names, asked=None):
    found = find_stages(names, names if asked is None else asked)
    return [(one.axes, one.sought, one.given, one.before) for one in found]


def test_axes_that_need_each_other_are_sought_together_after_those_they_need():
    names = ["N_ur", "N_uv", "Y_uv", "Y_ur", "X_uabsu", "T_nabsn", "Z_uw"]
    assert stages(names) == [
        ("X", ("X_uabsu", "T_nabsn"), (), ()),
        ("Z", ("Z_uw",), ("u",), (0,)),
        ("NY", ("N_ur", "N_uv", "Y_uv", "Y_ur"), ("u",), (0,)),
    ]


def test_axes_that_need_nothing_come_in_the_order_of_their_unknowns():
    assert stages(["X_u", "X_uabsu", "Y_vabsv", "N_rabsr", "K_pabsp"]) == [
        ("N", ("N_rabsr",), (), ()),
        ("Y", ("Y_vabsv",), (), ()),
        ("K", ("K_pabsp",), (), ()),
        ("X", ("X_u", "X_uabsu"), (), ()),
    ]


def test_a_circle_through_three_axes_is_one_stage():
    ((axes, _, given, before),) = stages(["X_vr", "Y_ur", "N_uv"])
    assert (set(axes), given, before) == (set("XYN"), (), ())


def test_an_axis_without_a_goal_goes_with_the_axis_that_needs_it_and_else_is_left_out():
    names = ["X_uabsu", "N_ur", "K_p"]
    assert stages(names, ["N_ur"]) == [("XN", ("X_uabsu", "N_ur"), (), ())]
