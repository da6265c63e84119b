"""The page: complete in itself, safe whatever names it prints, well formed, and the same bytes for the same results."""

import re
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from html.parser import HTMLParser

import numpy as np
import pytest

from seatrial.campaign.inference.coefficient_csv import averaged_rows, quote_rows
from seatrial.campaign.inference.judge_predictions import fit_complaints
from seatrial.campaign.workflow.loop import summarise
from seatrial.campaign.workflow.next_trial import propose
from seatrial.cli.answer import Answer
from seatrial.cli.commands.loop import _tell_and_report
from seatrial.core.findings import Finding
from seatrial.messages.catalogue import ENTRIES
from seatrial.messages.predictions import comparison_text
from seatrial.messages.render import sentences
from seatrial.messages.structures import QUOTED
from seatrial.report import drawing
from seatrial.report.drawing import digits_of, moments_of
from seatrial.report.page import CONTENTS, write_report
from seatrial.report.page import render as rendered
from seatrial.report.sections.fits import _split, first_run, fits_section
from seatrial.report.sections.models import models_section
from seatrial.report.sections.summary import answer
from seatrial.selection.verdict import averaged
from tests.report.outcomes import EVIL, FITTED, HELD, make_compared, make_contenders, make_outcome, make_pooled

VOID = {"meta", "link", "br", "img", "input", "hr"}


class Page(HTMLParser):
    """What a browser would find: elements with their attributes, text, and whether every tag is closed."""

    def __init__(self, html: str):
        super().__init__()
        self.elements, self.open, self.text = [], [], []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    return make_outcome(tmp_path_factory.mktemp("report"))


def render(outcome):
    """Return the page without the marks of the words that it explains."""
    html = rendered(outcome)
    assert html.count('<abbr class="word"') > 5
    return re.sub('<abbr class="word"[^>]*>(.*?)</abbr>', r"\1", html)


@pytest.fixture(scope="module")
def html(outcome):
    return render(outcome)


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


@pytest.fixture
def undrawn(monkeypatch):
    """Leave figures empty where a test reads words only: drawing is two thirds of the time of a page."""
    monkeypatch.setattr(drawing, "draw_svg", lambda *_: '<svg viewBox="0 0 1 1"></svg>')


def test_the_page_is_written_whole_beside_the_campaign(outcome, html):
    path = write_report(outcome)
    assert path == outcome.campaign.folder / "report.html"
    assert path.read_text(encoding="utf-8") == rendered(outcome)
    assert len(html.encode()) < 1_000_000
    assert not list(path.parent.glob("*.part"))


def test_the_same_results_give_the_same_bytes_whatever_the_user_has_configured(outcome, html):
    import matplotlib

    with matplotlib.rc_context({"axes.linewidth": 9.0, "font.size": 30.0, "axes.unicode_minus": False}):
        assert render(outcome) == html


def test_nothing_is_loaded_from_elsewhere(html, page):
    assert not re.search(r"https?://", html)
    assert not re.search(r"@import|url\((?!#)", html)
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"iframe", "object", "embed", "img", "image", "form", "base"}
    for tag, attributes in page.elements:
        assert not any(name.startswith("on") for name in attributes), tag
        for name in ("src", "href", "xlink:href", "action"):
            assert attributes.get(name, "#").startswith(("#", "data:,")), (tag, attributes)


def test_the_only_script_is_the_one_that_the_page_names_by_its_hash(html, page):
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    assert len(scripts) == sum(tag == "script" for tag, _ in page.elements) == 1
    digest = b64encode(sha256(scripts[0].encode()).digest()).decode()
    assert f"default-src 'none'; script-src 'sha256-{digest}'; style-src" in html
    assert "unsafe-inline" not in re.findall(r"script-src [^;]*;", html)[0]
    assert "innerHTML" not in scripts[0]


def test_names_from_files_are_text(html, page):
    assert EVIL not in html
    assert "<b>" not in html
    text = "".join(page.text)
    for name in (EVIL, f"Run {FITTED[1]}", f"Run {HELD}"):
        assert name in text


def test_every_tag_is_closed_and_every_reference_has_its_target(html, page):
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    references = set(re.findall(r'url\(#([^)]*)\)|href="#([^"]*)"', html))
    labelled = {name for _, attributes in page.elements for name in (attributes.get("aria-labelledby") or "").split()}
    assert {a or b for a, b in references} | labelled <= set(ids)


def test_sections_come_in_order_and_figures_have_titles(html, page):
    headings = re.findall(r'<h2 id="[a-z]+-heading">([^<]*)</h2>', html)
    assert headings == list(CONTENTS.values())
    figures = [attributes for tag, attributes in page.elements if tag == "svg"]
    assert len(figures) >= 15
    assert all(attributes["role"] == "img" and attributes["aria-labelledby"] for attributes in figures)


def test_held_back_records_are_marked(html):
    assert html.count('<span class="badge held">held back</span>') == 1 + 2 + 1


def test_the_first_figure_is_of_the_held_back_run_that_moves_most_and_stands_once(outcome, html):
    first = html[html.index('id="summary"') : html.index('id="models"')]
    assert first.index("Values ± standard deviation") < first.index(
        f"<h3>Run {HELD}, held back: measured and predicted"
    )
    assert first.count("<svg") == 1
    index = first_run(outcome)
    assert index == len(outcome.trials.fit)
    assert f'id="fit-{index}-title"' not in html
    assert f'id="residuals-{index}-title"' in html
    assert f'id="fit-{1 - index % 2}-title"' in html
    fitted = replace(outcome, trials=replace(outcome.trials, predict=()))
    rows = outcome.predictions["record"].values
    data = outcome.predictions.copy(deep=True)
    for moves in (0, 1):
        data["measured"][...] = np.where((rows == moves)[:, None], 2.0, 1.0) * outcome.predictions["measured"].values
        assert first_run(replace(fitted, predictions=data)) == moves


def test_the_first_figure_and_the_section_share_the_panels_of_a_run_between_them():
    assert _split(list("uvwpqr"), list("ab")) == ((["u", "v", "w"], ["a", "b"]), (["p", "q", "r"], []))
    assert _split(list("uv"), list("abc")) == ((["u", "v"], []), ([], ["a", "b", "c"]))


def test_the_table_can_be_copied_and_names_its_csv(html):
    first = html[html.index('id="summary"') : html.index('id="models"')]
    table = first[first.index('id="values"') : first.index("</table>")]
    assert 'title="X_uabsu"' in table
    assert first.index("results/quote.csv") > first.index('id="copy"') > first.index("</table>")
    assert 'getElementById("copy")' in html[html.index("<script>") :]


def test_what_lies_below_the_answer_folds_and_opens_for_print(html):
    first = html[html.index('id="summary"') : html.index('id="models"')]
    assert all(f"<h3>{head}</h3>" in first for head in ("Values ± standard deviation", "Which model", "What is wrong"))
    assert first.index("Values ± standard deviation") < first.index("<details")
    assert "<details open" not in html
    assert "details::details-content { content-visibility: visible" in html[html.index("@media print") :]
    assert 'addEventListener("beforeprint"' in html


def test_a_model_has_one_name_and_its_label_stands_in_small_print_only(html):
    body = re.sub(
        "<svg.*?</svg>", "", html[html.index("<main>") : html.index("<summary>Files</summary>")], flags=re.DOTALL
    )
    assert "linear and quadratic drag" in body
    assert len(re.findall(r"<small>M-\d</small>", body)) == 2 * 4
    assert not re.findall(r"M-\d", re.sub(r"<small>M-\d</small>", "", body))


def test_a_probability_of_a_model_stands_once_and_the_average_beside_the_chosen_values(outcome, html):
    share = f"{outcome.selection.probability[0]:.2f}"
    assert html.count(f"<td>{share}</td>") == 1
    moments = [moments_of(outcome, estimate) for estimate in outcome.estimates]
    name = "X_uabsu"
    digits, average = digits_of(outcome)[name], averaged(moments, outcome.selection.probability)[name]
    row = next(item for item in outcome.summary.coefficients if item.name == name)
    chosen = digits.pair(row.mean, row.sd)
    assert re.search(rf'<td class="value" data-head="Value ± sd">{re.escape(chosen)}<', html)
    assert f'<td data-head="Averaged">{digits.pair(*average)}</td>' in html


def test_the_page_says_where_a_predicted_run_starts(outcome, html):
    assert (
        "the start of a fitted run is fitted to the whole of that run, that of a held-back run only to its first sample"
        in html
    )
    estimation = outcome.campaign.estimation
    for initial, said in (("trim", "from the trim"), ("measured", "its first sample")):
        changed = replace(
            outcome, campaign=replace(outcome.campaign, estimation=estimation.model_copy(update={"initial": initial}))
        )
        assert fits_section(changed)["basis"].endswith(said)


@pytest.mark.usefixtures("undrawn")
def test_alarms_come_first_and_take_the_answer_over(tmp_path):
    names = ("X_u", "X_uabsu", "delay")
    alarms = tuple(
        f"M-0: the chains disagree about {name} (R-hat 1.0{index}3, at most 1.01): run longer"
        for index, name in enumerate(names)
    )
    html = render(alarmed(tmp_path, *alarms, "the evidence of M-1 is not reliable: repeats differ by 3.6 nats"))
    assert "Do not use these numbers yet: 4 health checks failed" in html
    said = html[html.index('id="summary"') : html.index('id="models"')]
    assert said.index('class="alarm"') < said.index('class="finding"') < said.index('class="caution"')
    assert said.count('<li class="alarm">') == 2
    assert "Likewise" in said


def alarmed(folder, *alarms):
    """An outcome with these alarms and no others, in which M-1 is in question."""
    outcome = make_outcome(folder, alarms)
    selection = replace(outcome.selection, probability=np.array([0.9, 0.1, 0.0, 0.0]))
    return replace(outcome, selection=selection, cross_validation=None)


@pytest.mark.usefixtures("undrawn")
def test_alarms_of_other_models_leave_the_values_of_the_chosen_one(tmp_path):
    html = render(alarmed(tmp_path, "M-1: the chains disagree about X_u (R-hat 1.03, at most 1.01): run longer"))
    assert "Do not use" not in html
    assert "Another model is not reliable: 1 health check failed." in html
    assert "its values may be used" in html
    assert '<p class="answer" id=' in html
    html = render(alarmed(tmp_path, "the evidence of M-1 is not reliable: repeats differ by 3.6 nats"))
    assert "The choice of the model is not reliable: 1 health check failed." in html


@pytest.mark.usefixtures("undrawn")
def test_what_need_not_be_seen_at_first_is_folded(outcome, html, tmp_path):
    def part(text, name, end):
        return text[text.index(f'id="{name}"') : text.index(f'id="{end}"')]

    quiet = [replace(one, left=0.1, correlation=0.2) for one in outcome.known.parameters]
    outcome = replace(outcome, known=replace(outcome.known, parameters=tuple(quiet)))
    parameters = part(render(outcome), "parameters", "method")
    seen, folded = parameters.split(" in detail: delay, noise")
    assert all(f"<code>{name}</code>" in seen for name in outcome.chosen.structure.terms)
    assert "<code>sigma_u</code>" in folded
    rows = [replace(row, ess_bulk=3.0) if row.name == "sigma_u" else row for row in outcome.summary.coefficients]
    told = render(replace(outcome, summary=replace(outcome.summary, coefficients=tuple(rows))))
    seen, _ = part(told, "parameters", "method").split(" in detail: delay, noise")
    assert "<code>sigma_u</code>" in seen  # what is flagged is never folded away

    assert "The best design, if another trial is run" not in html
    stopped = render(make_outcome(tmp_path, gain=0.01))
    following = part(stopped, "next", "parameters")
    assert following.index("The best design, if another trial is run</summary>") < following.index("<svg")
    is_settled = outcome.selection.is_settled
    assert ("How the two most probable models differ</summary>" in html) == is_settled


@pytest.mark.usefixtures("undrawn")
def test_the_average_stands_only_where_it_differs(outcome, html):
    assert 'data-head="Averaged"' in html
    assert 'data-head="Averaged"' not in render(decided_by(outcome, (1.0, 0.0, 0.0, 0.0)))


def bold_values(html):
    """Texts of the bold cells of the first screen's coefficients."""
    table = html[html.index('id="summary"') : html.index('<details class="more">')]
    return [re.sub("<small.*?</small>", "", text) for text in re.findall(r'<td class="value"[^>]*>(.*?)</td>', table)]


def decided_by(made, probability):
    """The outcome with these probabilities of its structures."""
    selection = replace(made.selection, probability=np.array(probability), probability_error=np.zeros(4))
    outcome = replace(made, selection=selection)
    rows = quote_rows(selection.quoted, made.summary.coefficients, averaged_rows(made.estimates, selection))
    averages = averaged_rows(made.estimates, selection)
    return replace(outcome, summary=replace(made.summary, averaged=averages, quoted=selection.quoted, quote=rows))


@pytest.mark.usefixtures("undrawn")
def test_the_bold_value_is_the_one_that_the_rule_names(tmp_path):
    """The mixture by hand."""
    made, p = make_outcome(tmp_path), (0.6, 0.3, 0.1, 0.0)
    open_ = decided_by(made, p)
    html, digits = render(open_), digits_of(open_)
    expected = []
    for name in ("X_tau_X", "X_u", "X_uabsu"):
        sums = np.zeros(2)
        for weight, one in zip(p, made.estimates, strict=True):
            if name in one.names:
                row = one.data.sel(parameter=name)
                mean, sd = (float(row[key]) for key in ("mean", "sd"))
                sums += weight * np.array([mean, mean**2 + sd**2])
        expected.append(digits[name].pair(sums[0], np.sqrt(sums[1] - sums[0] ** 2)))
    assert bold_values(html) == expected
    assert f"Bold: the values to quote.</strong> They are {QUOTED['averaged']}." in html
    decided = render(decided_by(made, (1.0, 0.0, 0.0, 0.0)))
    means = {row.name: (row.mean, row.sd) for row in made.summary.coefficients}
    assert bold_values(decided) == [digits[name].pair(*means[name]) for name in ("X_tau_X", "X_u", "X_uabsu")]
    assert f"Bold: the values to quote.</strong> They are {QUOTED['chosen']}." in decided
    alarm = render(alarmed(tmp_path / "alarmed", "M-0: the chains disagree about X_u (R-hat 1.03): run longer"))
    assert "values to quote" not in alarm
    assert bold_values(alarm) == []


@pytest.mark.usefixtures("undrawn")
def test_the_terminal_prints_the_values_to_quote(tmp_path, capsys):
    made = make_outcome(tmp_path)
    for p, quoted in (((0.6, 0.3, 0.1, 0.0), "averaged"), ((1.0, 0.0, 0.0, 0.0), "chosen")):
        outcome, answer = decided_by(made, p), Answer("run")
        _tell_and_report(answer, outcome, propose(outcome))
        lines = capsys.readouterr().out.splitlines()
        at = lines.index(f"  These are the values to quote: {QUOTED[quoted]}.")
        rows = [row for line in lines[:at] if (row := re.fullmatch(r"  +(.*?) +\S+ ± (\S+) .*", line))]
        assert [row.groups() for row in rows] == [(row.name, f"{row.sd:.3g}") for row in outcome.summary.quote]
        assert answer.content["result"]["quoted"] == quoted
        assert [row["sd"] for row in answer.content["result"]["quote"]] == [row.sd for row in outcome.summary.quote]


def test_other_models_stand_beside_the_chosen_one(outcome):
    digits, other = digits_of(outcome)["X_tau_X"], outcome.estimates[1]
    assert other is not outcome.chosen
    value = models_section(outcome)["beside"]["rows"][0]["values"][0]
    assert value == digits.pair(*moments_of(outcome, other)["X_tau_X"])


def test_the_page_names_the_prior_of_the_models(outcome):
    other = replace(outcome, selection=replace(outcome.selection, structure_prior="multiplicity"))
    for one, words in ((outcome, "every structure is equally"), (other, "every number of optional terms is equally")):
        text = " ".join(render(one).split())
        assert f"Before the data {words} probable." in text
    assert "With as many terms, 1 nat behind is 2.7 times less probable" in text


def test_a_value_names_what_its_standard_deviation_is_made_of(html):
    assert re.search(r'<small class="cause">model 90\s%, noise 10\s%: a force', html)


def test_the_effects_that_were_tried_are_listed(html):
    listed = html[html.index("The 2 effects that the ± contains</summary>") :]
    assert re.findall(r"<li>(.*?)</li>", listed)[:2] == [
        'a force <span class="symbol"><i>X</i><sub><i>u</i><sup>3</sup></sub></span>',
        "a lag of the actuator of n",
    ]


@pytest.mark.usefixtures("undrawn")
def test_a_caution_about_the_noise_is_told_once(outcome):
    verdict = replace(ENTRIES["residuals-correlated"].example, remedies=("drifting-noise",))
    fits = tuple(replace(fit, verdict=verdict) for fit in outcome.fits if not fit.held_back)
    summary = replace(outcome.summary, cautions=tuple(sentences(fit_complaints(fits))))
    noise = Finding("main-error", "note", ("X_u",), {"effects": ()}, ("better-noise",))
    outcome = replace(outcome, chosen=replace(outcome.chosen, cause_findings=(noise,)))
    html = render(replace(outcome, summary=summary, fits=fits, cross_validation=None))
    assert html.lower().count("set estimation.residuals") == 1
    assert "most of the ± is from slow errors of the sensors. Set estimation.residuals" in render(outcome)


@pytest.mark.usefixtures("undrawn")
def test_a_page_without_cautions_has_none_in_any_section(tmp_path):
    """Cautions about the open question, the design and the parameters, in the summary and thus on every surface, or nowhere."""
    made = make_outcome(tmp_path)
    selection = replace(made.selection, probability=np.array([0.6, 0.3, 0.1, 0.0]))
    (held_back,) = made.trials.predict
    trials = replace(made.trials, predict=(replace(held_back, control=0.5 * held_back.control),))
    made = replace(made, trials=trials, fits=(), pooled=(), compared=(), cross_validation=None, selection=selection)
    quiet = [replace(one, sd=0.1 * abs(one.value), left=0.1, correlation=0.2) for one in made.known.parameters]
    known = replace(made.known, verdict=(), parameters=tuple(quiet))
    promised = replace(made.known, stage="before", verdict=("X_u would be 0 ± 2",))
    for nats, sd, count in ((5.0, quiet[0].sd, 0), (0.01, 9.0, 1)):
        unsure = replace(known, parameters=(replace(quiet[0], sd=sd), *quiet[1:]))
        undecided = replace(made, known=unsure, contenders=make_contenders(made.campaign, selection, nats))
        outcome = replace(undecided, first=made.next, promised=promised)
        outcome = replace(outcome, summary=summarise(outcome))
        html = render(outcome)
        assert len(outcome.summary.cautions) == count
        assert ("there is no caution" in html) == (count == 0) == ('<li class="caution">' not in html)
        assert "No design of this family would decide" in html or nats > 3


@pytest.mark.usefixtures("undrawn")
def test_what_is_folded_is_counted(tmp_path):
    outcome = make_outcome(tmp_path)
    words = ("the first", "another one", "something else", "and one more")
    for count, said in ((2, ""), (4, "2 more cautions<")):
        html = render(replace(outcome, summary=replace(outcome.summary, cautions=tuple(words[:count]))))
        assert said in html
        assert ("more caution" in html) == bool(said)


@pytest.mark.usefixtures("undrawn")
def test_a_family_that_is_exhausted_is_said_to_be(tmp_path):
    html = render(make_outcome(tmp_path, gain=0.01))
    assert "another trial of this kind would give little information" in html
    assert "Run a repeated doublet" not in html


def test_chains_that_never_moved_do_not_break_the_page(tmp_path):
    outcome = make_outcome(tmp_path)
    for estimate in outcome.estimates:
        for name in ("draws", "mode", "mean"):
            estimate.data[name][...] = 0.3
        for name in ("sd", "laplace_sd"):
            estimate.data[name][...] = 0.0
        for name in ("r_hat", "ess_bulk", "ess_tail"):
            estimate.data[name][...] = np.nan
    numbers = dict.fromkeys(("mean", "lower_95", "upper_95"), 0.3) | dict.fromkeys(
        ("r_hat", "ess_bulk", "ess_tail"), np.nan
    )
    rows = tuple(replace(row, sd=0.0, **numbers) for row in outcome.summary.coefficients)
    outcome = replace(outcome, summary=replace(outcome.summary, coefficients=rows))
    assert "0.3000" in render(outcome)


def test_what_is_known_together_is_named_and_what_is_not_is_flagged(html):
    said = html[html.index('id="parameters"') : html.index('id="method"')]
    assert "to 2\u202f%" in said
    assert "run &lt;b&gt;faster&lt;/b&gt;" in said
    assert said.count('<span class="flag"') >= 4
    assert "known only in combination" in said
    assert "+190\u202f%" in said
    assert "prior sd" in said


@pytest.mark.usefixtures("undrawn")
def test_a_design_is_judged_before_the_data(tmp_path):
    outcome = make_outcome(tmp_path)
    before = replace(outcome, first=outcome.next, promised=replace(outcome.known, stage="before", directions=()))
    html = render(before)
    said = html[html.index('id="next"') : html.index('id="parameters"')]
    assert "Expected before the trial" in said
    assert "run &lt;b&gt;faster&lt;/b&gt;" in said
    assert "Expected before the trial" not in render(outcome)


@pytest.mark.usefixtures("undrawn")
def test_a_campaign_in_which_nothing_was_scored_says_so(tmp_path):
    html = render(replace(make_outcome(tmp_path), fits=(), compared=(), pooled=()))
    assert "No measurement could be compared" in html


@pytest.mark.usefixtures("undrawn")
def test_a_model_beside_simpler_ones(html, tmp_path):
    said = html[html.index('id="fit"') : html.index('id="next"')]
    assert "the model predicts u better than every baseline" in said
    table = said[said.index("<summary>Comparison with baselines") :]
    assert table[: table.index("</table>")].count("<tr") == 4
    assert "Not fitted: nomoto; no yaw rate r is among the channels &lt;script&gt;" in said
    alone = render(replace(make_outcome(tmp_path / "alone"), baselines=None, compared=()))
    assert "No run is held back, so no baseline could be compared." in alone


def test_the_headline_tells_a_model_that_is_beaten_from_one_that_fails(tmp_path):
    beaten = replace(alarmed(tmp_path), compared=make_compared(0.2))
    alarms = (*beaten.summary.alarms, comparison_text(beaten.compared[0]))
    beaten = replace(beaten, summary=replace(beaten.summary, alarms=alarms))
    assert answer(beaten).startswith(
        "Do not use this model: another predicts better. Held-back runs: a first-order lag of the controls predicts u better"
    )
    assert "failed too" not in answer(beaten)
    even = answer(replace(make_outcome(tmp_path), compared=make_compared(0.051)))
    assert even.startswith("A first-order lag of the controls predicts u of the held-back runs as well as this model. ")
    failing = replace(make_outcome(tmp_path), pooled=make_pooled(0.2))
    assert answer(failing).startswith("The model fails on held-back runs. 14 % of u in 3 held-back runs lies ")


@pytest.mark.usefixtures("undrawn")
def test_a_name_that_turns_the_text_around_is_shown_as_it_is_written(outcome):
    html = render(replace(outcome, campaign=replace(outcome.campaign, name="a\x1b\u202eb")))
    assert r"<title>a\u001b\u202eb" in html
    assert not {*html} & {*"\x1b\u202e"}
