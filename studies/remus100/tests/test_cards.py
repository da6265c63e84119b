"""One item as the page prints it: numbers with their errors, settings with their units, sentences as a book has them."""

import pytest

from seatrial.report.numbers import plain, typeset
from studies.remus100.page import MAX_TABLE_ROWS, card, settings_rows
from studies.remus100.study import Item, Number
from studies.remus100.tests.studies import A


def printed(*numbers: Number, **settings):
    return card(Item("table-3", "A title", "contradicted", "", numbers, settings), A)


@pytest.mark.parametrize(
    ("written", "set"),
    [
        ("P x 1e4", "P × 10⁴"),
        ("8.0e-04 m/s^2", "8.0 × 10⁻⁴ m/s²"),
        ("+-200 rpm, -0.5 (-1)", "±200 rpm, −0.5 (−1)"),
        ("H = -E[log p], m - X_udot", "H = −E[log p], m − X_udot"),
        ("87% of M-1", "87 % of M-1"),
    ],
)
def test_sentences_are_typeset(written, set):
    assert typeset(written) == set


def test_plain_numbers_keep_what_was_printed():
    assert [plain(value, 6) for value in (-13939.8, 0.4642, -0.8000000000010914)] == ["−13939.8", "0.4642", "−0.8"]
    assert [plain(value) for value in (99999.0, 12345.6, 0.0, 1200.0)] == ["1 × 10⁵", "1.235 × 10⁴", "0", "1200"]


def test_a_number_is_rounded_to_its_error():
    (rows,) = printed(Number("a", -1.21, -1.12436, 0.00255), Number("b", None, 5.7e-5, 2e-6))["tables"]
    assert (rows[0]["printed"], rows[0]["found"], rows[0]["error"]) == ("−1.21", "−1.1244", "0.0026")
    assert (rows[1]["printed"], rows[1]["found"], rows[1]["error"], rows[1]["power"]) == ("", "5.70", "0.20", " × 10⁻⁵")


def test_empty_columns_are_left_out_and_long_tables_are_halved():
    many = printed(*[Number(f"n{i}", None, float(i)) for i in range(MAX_TABLE_ROWS + 1)])
    assert [len(rows) for rows in many["tables"]] == [7, 6]
    assert not many["has_printed"]
    assert not many["has_error"]
    assert printed()["tables"] == []


def test_settings_have_units_and_long_texts_stand_apart():
    one = printed(steps_rpm=400.0, hold_s=2.0, noise_free=True, data_seeds=[1, 2], X_du3=0.1, said=["a b", "c d"])
    words = [str(setting) for setting in one["settings"]]
    assert words[:4] == ["steps 400 rpm", "hold 2 s", "noise free yes", "data seeds 1, 2"]
    assert "Δ" in words[4]
    assert one["said"] == [("Said", ["A b.", "C d."])]


def test_what_the_paper_leaves_open_is_read_from_the_vehicle():
    rows = {what: str(words) for what, words in settings_rows(A)}
    assert "750 rpm" in rows["Units of T and n"]
    assert "±400 rpm" in rows["Input of Figures 1 and 2"]
    assert "10⁴" in rows["P of the filters"]
