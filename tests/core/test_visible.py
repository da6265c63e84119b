import json

import pytest

from seatrial.core.visible import visible


@pytest.mark.parametrize("plain", ["", "u [m/s]\t1\n", "Übung ± 3°", "深度", "שלום", "\u200eعمق"])
def test_what_people_write_stays(plain):
    assert visible(plain) == plain


@pytest.mark.parametrize(
    "hidden", ["\x00", "\x08", "\r", "\x1b", "\x7f", "\x9b", "\u2028", "\u202e", "\u2066", "\u2069", "\udcff"]
)
def test_what_a_terminal_obeys_is_shown_and_json_means_the_same(hidden):
    text = visible(json.dumps(f"a{hidden}b", ensure_ascii=False))
    assert text == f'"a\\u{ord(hidden):04x}b"' or text == json.dumps(f"a{hidden}b", ensure_ascii=False)
    assert visible(f"a{hidden}b").isprintable()
    assert json.loads(text) == f"a{hidden}b"
