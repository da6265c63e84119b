import pytest

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import SIGNALS, signal_label
from seatrial.report.drawing import signal_symbol
from seatrial.report.labels import label_html, label_mathtext, name_html, name_mathtext, sentence_html


def bare(label: str) -> str:
    html = str(label_html(label))
    assert html.startswith('<span class="symbol">')
    return html.removeprefix('<span class="symbol">').removesuffix("</span>")


@pytest.mark.parametrize(
    ("label", "html"),
    [
        ("X_{u|u|}", "<i>X</i><sub><i>u</i>|<i>u</i>|</sub>"),
        (r"X_{\Delta u^3}", "<i>X</i><sub>Δ<i>u</i><sup>3</sup></sub>"),
        (r"\sigma_{u}", "<i>σ</i><sub><i>u</i></sub>"),
        (r"X_{\tau_X}", "<i>X</i><sub><i>τ</i><sub><i>X</i></sub></sub>"),
        (r"t_{\mathrm{delay}}", "<i>t</i><sub>delay</sub>"),
        (r"\sigma_{\dot{u}}", "<i>σ</i><sub><i>u̇</i></sub>"),
        ("X_{0}", "<i>X</i><sub>0</sub>"),
        ("u_0[3]", "<i>u</i><sub>0</sub>[3]"),
        ("u_0[a_b^{c}<i>]", "<i>u</i><sub>0</sub>[a_b^{c}&lt;i&gt;]"),
        ("X_{u", "<i>X</i><sub><i>u</i></sub>"),
        ("X_", "<i>X</i><sub></sub>"),
    ],
)
def test_labels_become_html(label, html):
    assert bare(label) == html


def test_labels_become_mathtext_for_figures():
    assert label_mathtext("u_0[$1_2$]") == r"$u_{0}$[\$1_2\$]"
    assert label_mathtext(r"t_{\mathrm{delay}}") == r"$t_{\mathrm{delay}}$"


@pytest.mark.parametrize(
    "name", ["X_udot", "X_uu", "X_uabsu", "T_nabsn", "X_du3", "Y_uudelta_r", "N_absrdelta_r2", "X_tau_X", "X_0"]
)
def test_matplotlib_accepts_the_label_of_every_kind_of_coefficient(name):
    from matplotlib.mathtext import MathTextParser

    MathTextParser("path").parse(label_mathtext(CoefficientName.parse(name).label))


def test_thrusters_are_numbered_below():
    assert bare(signal_label("f_1")) == "<i>f</i><sub>1</sub>"
    assert bare(signal_label("n_12")) == "<i>n</i><sub>12</sub>"
    assert name_mathtext("f_12") == signal_symbol("f_12") == "$f_{12}$"


def test_matplotlib_accepts_every_signal():
    from matplotlib.mathtext import MathTextParser

    for signal in SIGNALS.values():
        MathTextParser("path").parse(label_mathtext(signal.label))
        assert "\\" not in label_html(signal.label)


def test_names_in_sentences_are_printed_by_their_labels_and_the_rest_is_escaped():
    labels = {"X_u": "X_{u}", "X_uabsu": "X_{u|u|}", "u_0[3]": "u_0[3]"}
    html = str(name_html("X_u, X_uabsu and u_0[3], not X_udot <b>", labels))
    assert html.count('<span class="symbol">') == 3
    assert "not X_udot &lt;b&gt;" in html
    assert str(name_html("<i>", {})) == "&lt;i&gt;"
    assert str(name_html("run `seatrial X_u <b>`, or `", labels)) == "run <code>seatrial X_u &lt;b&gt;</code>, or `"
    assert sentence_html("`a --by -1` is m/s^2", {}) == "<code>a --by -1</code> is m/s²."
