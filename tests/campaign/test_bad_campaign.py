"""Campaign files that nobody should write: each ends in an error that names the file, the line and the key, and in no traceback."""

import re

import pytest

from seatrial.campaign.config import toml as toml_file
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.toml_edit import with_values
from seatrial.campaign.data.import_logs import import_trials
from seatrial.core.errors import InputError
from tests.campaign.small import SMALL, write_small
from tests.campaign.test_whole_vehicle import pitch
from tests.campaign.yaw_campaign import write_yaw

SEED, DURATION, NOISE = "seed = 3", 'duration = "30 s"', 'noise = "0.05 m/s"'
VALUES = {
    "a time beyond double precision": ((DURATION, 'duration = "1e308 s"'), "design.duration", "1e+30"),
    "a rate beyond double precision": ((NOISE, f'{NOISE}\nrate = "1e-308 Hz"'), "sensors.u.rate", "1e-30"),
    "a rate of nothing": ((NOISE, f'{NOISE}\nrate = "0 Hz"'), "sensors.u.rate", "more than 0"),
    "an active time below zero": (('active = "20 s"', 'active = "-20 s"'), "design.active", "above 0"),
    "a start below zero": (('active = "20 s"', 'active = "20 s"\nstart = "-1 s"'), "design.start", "0 or more"),
    "an edge below zero": (('active = "20 s"', 'active = "20 s"\nramp = "-1 s"'), "design.ramp", "0 or more"),
    "a huge integer": ((SEED, f"seed = {10**400}"), "campaign.seed", "less than"),
    "a huge integer for a number": (("X_u = -1.21", f"X_u = {10**400}"), "truth.X_u", ""),
    "a huge hexadecimal integer": ((SEED, f"seed = 0x{'f' * 5000}"), "campaign.seed", "20000 bits"),
    "not a number": (("X_u = -1.21", "X_u = nan"), "truth.X_u", "finite"),
    "infinite": (("X_u = -1.21", "X_u = -inf"), "truth.X_u", "finite"),
    "an empty list": (("chains = 16", "chains = []"), "estimation.chains", "integer"),
    "a list for a name": ((DURATION, f"{DURATION}\nfilter = []"), "design.filter", "'extended'"),
    "no family": (('control = "n"', 'control = "n"\nfamilies = []'), "design.families", "at least 1"),
    "a number in a list of names": (('optional = ["X_u"]', 'optional = ["X_u", 3]'), "structure.optional.1", "text"),
    "two kinds of value, and neither": ((SEED, f"{SEED}\n[goal]\nsd = {{ X_u = [] }}"), "goal.sd.X_u", " or "),
    "a unit that is none, in quotes of three": ((NOISE, 'noise = """0.05\nm/x"""'), "sensors.u.noise", "unit"),
}
UNREADABLE = {
    "an integer of thousands of digits": (SMALL.replace(SEED, f"seed = {'9' * 5000}"), 4, "thousands of digits"),
    "lists within lists": (SMALL.replace(SEED, f"seed = {'[' * 2000}"), 4, "at most 12 levels"),
    "tables within tables": (SMALL.replace(SEED, f"{'.'.join('abcdefghijklmnop')} = 1"), 4, "at most 12 levels"),
    "a key without end": (SMALL.replace(SEED, "a." * 400_000 + "a = 1"), 4, "at most 12 levels"),
    "a key that stands twice": (SMALL.replace(SEED, f"{SEED}\n{SEED}"), 5, "remove or rename the second"),
    "a table that stands twice": (f"{SMALL}\n[power]\n[truth]\n", SMALL.count("\n") + 3, "remove or rename the second"),
    "a byte of nothing": (SMALL.replace(SEED, "seed = 3 # \0"), 4, "malformed TOML"),
    "a string without end": (f'{SMALL}name = """', SMALL.count("\n") + 1, "malformed TOML"),
}

SLIPS = {
    "a quantity without quotes": (DURATION, "duration = 30 s", "put a number and its unit into quotes"),
    "a quote that is not closed": (DURATION, 'duration = "30 s', "close the quotes"),
    "quotes of a text processor": (DURATION, "duration = “30 s”", "straight quotes"),
    "a decimal comma": (SEED, "seed = 3,5", "decimal point"),
    "nothing before the point": (SEED, "seed = .5", "both sides of the decimal point"),
    "a colon for an equals sign": (SEED, "seed: 3", "write = after the key"),
    "a comment of another language": (SEED, "seed = 3 // mine", "#"),
    "a path of Windows": (SEED, 'seed = "C:\\logs\\a.csv"', "instead of each"),
    "true as Python writes it": (SEED, "seed = True", "small letters"),
    "a name without quotes": ('control = "n"', "control = n", "put text into quotes"),
    "a key of nothing": (SEED, "seed =", "write a value"),
}
KINDS = {
    "a name where a list is due": (('optional = ["X_u"]', 'optional = "X_u"'), "a list", 'write ["X_u"]'),
    "a misspelt choice": ((DURATION, f'{DURATION}\nfilter = "extendet"'), "'extended'", 'did you mean "extended"?'),
    "a number for a name": (('optional = ["X_u"]', 'optional = ["X_u", 3]'), "text in quotes", "put it into quotes"),
    "double brackets": ((SEED, f"{SEED}\n[[goal]]\ntrials = 3"), "a table", "single brackets"),
}


def refused(folder, text=None):
    if text is not None:
        (folder / "campaign.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as caught:
        load_campaign(folder)
    return caught.value


@pytest.mark.parametrize("name", VALUES)
def test_a_value_that_nothing_has_is_named_with_its_key_and_line(tmp_path, name):
    change, key, word = VALUES[name]
    folder = write_small(tmp_path, change)
    error = refused(folder)
    written = (folder / "campaign.toml").read_text().splitlines()
    line = next(n for n, text in enumerate(written, 1) if text not in SMALL and text != "[goal]")
    assert re.search(rf"campaign\.toml:{line}, key {re.escape(key)}", error.where), error.where
    assert word in f"{error.found} {error.expected}"


@pytest.mark.parametrize("name", UNREADABLE)
def test_a_file_that_cannot_be_read_is_named_with_its_line(tmp_path, name):
    text, line, word = UNREADABLE[name]
    error = refused(tmp_path, text)
    assert error.where.endswith(f"campaign.toml:{line}")
    assert word in f"{error.found} {error.expected} {error.remedy}"
    with pytest.raises(InputError):  # as the editor of single keys reads it
        with_values(text, {("campaign", "seed"): 4})


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_of_the_pen_is_shown_with_what_to_do_about_it(tmp_path, name):
    right, wrong, word = SLIPS[name]
    assert right in SMALL
    error = refused(tmp_path, SMALL.replace(right, wrong, 1))
    assert error.where.endswith(f":{SMALL[: SMALL.index(right)].count(chr(10)) + 1}")
    assert error.found.endswith(f"in the line: {wrong}" if right != 'control = "n"' else "control = n")
    assert word in error.remedy


@pytest.mark.parametrize("name", KINDS)
def test_a_value_of_the_wrong_kind_has_a_remedy_that_works(tmp_path, name):
    change, expected, remedy = KINDS[name]
    error = refused(write_small(tmp_path, change))
    assert expected in error.expected
    assert remedy in error.remedy


def test_a_file_too_large_is_not_read_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr(toml_file, "MOST_BYTES", len(SMALL) + 10)
    error = refused(tmp_path, SMALL + "#" * 100_000)
    assert "0.1 MB" in error.found


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_a_file_in_another_encoding(tmp_path, encoding):
    text = SMALL.replace('"small"', '"Gerät"').encode(encoding)
    if encoding == "utf-8-sig":
        (tmp_path / "campaign.toml").write_bytes(text)
        assert load_campaign(tmp_path).name == "Gerät"
    else:
        error = refused(tmp_path, text)
        assert error.where.endswith(f"campaign.toml:{1 if encoding == 'utf-16' else 3}")
        assert error.remedy == "save the file as UTF-8"


ACTUATORS = {
    "lagg = 1": ("lagg", "one of lag, lower, upper, rate", 'did you mean "lag"?'),
    "lag = 1": (
        "lag",
        'a number with a unit like "s", as one string',
        'write "1 s" or "1 ms" or "1 min", as intended',
    ),
}


def test_actuator_without_keys_or_control_is_refused(tmp_path):
    for name, keys, found in (("delta_x", 'lag = "1 s"', '"delta_x"'), ("delta_s", "", "a table without keys")):
        with pytest.raises(InputError) as caught:
            pitch(tmp_path, ("[structure]", f"[vehicle.actuators.{name}]\n{keys}\n[structure]"))
        assert re.search(rf"campaign\.toml:\d+, key vehicle\.actuators\.{name}$", caught.value.where)
        assert caught.value.found == found


@pytest.mark.parametrize("line", ACTUATORS)
def test_a_mistake_in_the_table_of_an_actuator(tmp_path, line):
    key, expected, remedy = ACTUATORS[line]
    with pytest.raises(InputError) as caught:
        pitch(tmp_path, ("[structure]", f"[vehicle.actuators.delta_s]\n{line}\n[structure]"))
    assert re.search(rf"campaign\.toml:\d+, key vehicle\.actuators\.delta_s\.{key}$", caught.value.where)
    assert (caught.value.expected, caught.value.remedy) == (expected, remedy)


@pytest.mark.parametrize("value", ["1", "-1"])
def test_an_added_mass_of_the_wrong_sign_is_refused(tmp_path, value):
    by_hand = f'mass = "30.48 kg"\nfixed = {{ X_udot = {value} }}\ntrim = {{ u = "1.5 m/s", n = "1200 rpm" }}'
    folder = write_small(tmp_path, ('catalogue = "remus100_surge"', by_hand))
    if value == "-1":
        assert load_campaign(folder).vehicle is not None
        return
    error = refused(folder)
    assert error.where.endswith("key vehicle.fixed.X_udot")
    assert error.remedy.startswith("write -1,")


IMPORTS = {
    "unit of another dimension": (('column = "r", unit = "deg/s"', 'column = "r", unit = "deg"'), "channels.r.unit"),
    "unknown unit": (('column = "t", unit = "s"', 'column = "t", unit = "sex"'), "time.unit"),
    "unknown channel": (("channels.r =", "channels.rr ="), "channels.rr"),
    "scale of nothing": (('unit = "deg/s"', 'unit = "deg/s", scale = 0'), "channels.r.scale"),
    "scale that is infinite": (('unit = "deg/s"', 'unit = "deg/s", scale = inf'), "channels.r.scale"),
    "offset that is no number": (('unit = "deg/s"', 'unit = "deg/s", offset = nan'), "channels.r.offset"),
    "step of nothing": (("[import]", '[import]\nstep = "0 s"'), "import.step"),
    "split below zero": (("[import]", '[import]\nsplit = "-5 s"'), "import.split"),
    "start below zero": (("[import]", '[import]\nstart = "-5 s"'), "import.start"),
    "end before the start": (("[import]", '[import]\nstart = "9 s"\nend = "5 s"'), "import.end"),
    "own end below zero": (
        ("[[import.files]]", '[import.trim.1]\nend = "-1 s"\n[[import.files]]'),
        "import.trim.1.end",
    ),
    "a run named twice": (('fit = ["1", "2"]', 'fit = ["1", "1"]'), "import.fit"),
    "a run in another folder": (('fit = ["1", "2"]', 'fit = ["../1"]'), "import.fit"),
    "a run on two lines": (('fit = ["1", "2"]', 'fit = ["1", "a\\nb"]'), "import.fit"),
    "a run too long for a file": (('fit = ["1", "2"]', f'fit = ["{"a" * 300}"]'), "import.fit"),
    "a header of a file without one": (('{ column = "t"', '{ column = "t"'), "header_rows"),
}


@pytest.mark.parametrize("name", IMPORTS)
def test_an_import_is_checked_before_any_log_is_opened(tmp_path, name):
    (old, new), key = IMPORTS[name]
    folder = write_yaw(tmp_path)
    text = (folder / "campaign.toml").read_text()
    assert old in text
    changed = text.replace(old, new)
    if key == "header_rows":
        changed = text.replace("channels.u =", 'header_rows = 2\nnames = ["t"]\nchannels.u =')
    error = refused(folder, changed)
    line = next(
        n for n, one in enumerate(changed.splitlines(), 1) if one not in text and not one.startswith('start = "9')
    )
    line += 1 if key == "import.trim.1.end" else 0
    assert re.search(rf"campaign\.toml:{line}, key import\..*{re.escape(key.removeprefix('import.'))}$", error.where), (
        error.where
    )


ONE_LOG = ("zigzag_{run}.csv", "zigzag_1.csv")
TRIMMED = """[import.trim.1]
end = "40 s"
[import.trim.2]
start = "{}"
[[import.files]]
path = """


def test_two_runs_that_read_the_same_log_over_the_same_time_are_refused(tmp_path):
    folder = write_yaw(tmp_path)
    text = (folder / "campaign.toml").read_text().replace(*ONE_LOG)
    error = refused(folder, text)
    assert error.where.endswith("key import.files[0].path")
    assert error.found == 'runs "1" and "2", which both read zigzag_1.csv over the same time: one trial counted twice'
    assert 'runs = ["1"] and runs = ["2"]' in error.remedy
    held_back = text.replace('fit = ["1", "2"]', 'fit = ["1"]\npredict = ["2"]')
    assert refused(folder, held_back).found == error.found
    overlap = text.replace("[[import.files]]\npath = ", TRIMMED.format("39 s"))
    assert refused(folder, overlap).found == error.found
    table = text[text.index("[[import.files]]") :]
    twice = f'{text}runs = ["1"]\n{table}runs = ["2"]\n'.replace("zigzag_1.csv", "./zigzag_1.csv", 1)
    assert "one trial counted twice" in refused(folder, twice).found


def test_two_runs_of_one_log_are_allowed_where_each_has_its_part_its_table_or_its_cut(tmp_path):
    folder = write_yaw(tmp_path)
    text = (folder / "campaign.toml").read_text().replace(*ONE_LOG)
    table = text[text.index("[[import.files]]") :]
    for changed in (
        text.replace("[[import.files]]\npath = ", TRIMMED.format("40 s")),
        f'{text}table = "a"\nruns = ["1"]\n{table}table = "b"\nruns = ["2"]\n',
        text.replace("[[import.files]]", '[[import.keep]]\npath = "on_{run}.csv"\nwhen = "on == 1"\n[[import.files]]'),
        text.replace("[import]", '[import]\nschedule = "plan_{run}.csv"'),
    ):
        (folder / "campaign.toml").write_text(changed)
        assert load_campaign(folder).imports.runs == ("1", "2")


@pytest.mark.parametrize("path", ["a" * 300, "~nobody-of-this-name/a.csv", "a\\u0000b", "$NOT_SET/a.csv"])
def test_a_path_that_no_file_can_have(tmp_path, path):
    folder = write_yaw(tmp_path)
    text = (folder / "campaign.toml").read_text().replace("zigzag_{run}.csv", path).replace('["1", "2"]', '["1"]')
    (folder / "campaign.toml").write_text(text)
    campaign = load_campaign(folder)
    with pytest.raises(InputError, match=r"campaign\.toml:\d+, key import\.files\[0\]\.path"):
        import_trials(campaign)


def test_an_earlier_campaign_that_no_folder_can_hold(tmp_path):
    error = refused(write_small(tmp_path, ('"remus100_surge"', f'"remus100_surge"\npriors_from = ["{"a" * 300}"]')))
    assert error.where.endswith("campaign.toml:8, key vehicle.priors_from")


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (("[structure]", '[estimation]\nresiduals = "proportional"\n[structure]'), "estimation.residuals"),
        (("[sensors.theta]", '[sensors.theta]\nresiduals = "proportional"'), "sensors.theta.residuals"),
    ],
)
def test_noise_in_proportion_to_an_angle_is_refused_by_the_key_that_asks_for_it(tmp_path, change, key):
    with pytest.raises(InputError, match=f'key {key}(.|\n)*"proportional", of an angle(.|\n)*residuals = "white"'):
        pitch(tmp_path, change)
