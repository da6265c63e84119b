"""Edits of a TOML file change the named values and nothing else: what a parser reads, and every comment of other tables."""

import difflib
import json
import tomllib

import pytest

from seatrial.campaign.config.templates import init_campaign
from seatrial.campaign.config.toml_edit import with_values
from seatrial.cli.campaign_text import read_file, with_trim, write_file
from seatrial.core.errors import InputError
from seatrial.dashboard.channel_map import typed_map, with_map

TEXT = """# A campaign.
[campaign]   # its name
name = "a # b"

# what the vehicle may do
[limits.n]
lower = "0 rpm"
  upper   =   '1500 rpm'   # the motor's own

[limits.u]
lower = "0.5 m/s"
# the end of u

[design]
amplitude = { from = "100 rpm", to = "200 rpm", points = 20 } # grid
"""


def put(text, key, value):
    return with_values(text, {tuple(key.split(".")): value})


def changed(new, old=TEXT):
    lines = difflib.ndiff(old.splitlines(), new.splitlines())
    return [line for line in lines if line[0] in "+-"]


def test_a_value_is_replaced_in_its_line():
    new = put(TEXT, "limits.n.upper", "1400 rpm")
    assert changed(new) == [
        "-   upper   =   '1500 rpm'   # the motor's own",
        '+   upper   =   "1400 rpm"   # the motor\'s own',
    ]


def test_a_missing_key_goes_below_the_last_of_its_table():
    new = put(TEXT, "limits.u.upper", "2 m/s")
    assert changed(new) == ['+ upper = "2 m/s"']
    assert 'lower = "0.5 m/s"\nupper = "2 m/s"\n# the end of u\n' in new
    text = "[estimation]\nchains = [\n  2,\n]\n\n# [import]\n# fit = ['a']\n"
    assert put(text, "estimation.residuals", "heavy") == text.replace("\n]\n", '\n]\nresiduals = "heavy"\n')
    assert put("[estimation]", "estimation.residuals", "heavy") == '[estimation]\nresiduals = "heavy"\n'


def test_a_missing_table_joins_its_kind():
    new = put(TEXT, "limits.distance.upper", "130 m")
    assert changed(new) == ["+ ", "+ [limits.distance]", '+ upper = "130 m"']
    assert tomllib.loads(new)["limits"]["distance"] == {"upper": "130 m"}


def test_a_key_is_removed():
    assert changed(put(TEXT, "limits.n.lower", None)) == ['- lower = "0 rpm"']


def test_a_key_of_a_table_in_one_line():
    new = put(TEXT, "design.amplitude.to", "150 rpm")
    assert tomllib.loads(new)["design"]["amplitude"] == {"from": "100 rpm", "to": "150 rpm", "points": 20}
    assert "# grid" in new
    assert len(changed(new)) == 2
    assert tomllib.loads(put(TEXT, "design.amplitude.points", 5))["design"]["amplitude"]["points"] == 5


@pytest.mark.parametrize("value", ['a "quoted" \\ one', "tab\there", "é ✓", "x\x7f", "#", "'", 1.5, 3, True])
def test_any_value_comes_back(value):
    assert tomllib.loads(put(TEXT, "limits.n.upper", value))["limits"]["n"]["upper"] == value


def test_line_ends_of_windows_stay():
    new = put(TEXT.replace("\n", "\r\n"), "limits.u.upper", "2 m/s")
    assert new.count("\r\n") == new.count("\n")


@pytest.mark.parametrize(
    "text",
    [
        'limits.n.upper = "1 rpm" # dotted\n',
        '[limits]\nn.upper = "1 rpm"\n',
        '[limits.n]\nupper = """1\nrpm"""\n# end\n',
        '["limits".n]\nupper = "1 rpm"\n',
        '[limits]\nn = { upper = "1 rpm", lower = "0 rpm" } # in one line\n',
        'note = """\n[limits.n]\nupper = "1"\n"""\n\n[limits.n]\nupper = "2"\n',
        '[limits.n]\nupper = "1 rpm"\n[x]\na = 1\n[limits.u]\nupper = 2\n',
    ],
)
@pytest.mark.parametrize("key", ["upper", "lower", "other"])
def test_a_key_is_found_however_it_is_written(text, key):
    wanted = tomllib.loads(text)
    wanted["limits"]["n"][key] = "2 rpm"
    new = put(text, f"limits.n.{key}", "2 rpm")
    assert tomllib.loads(new) == wanted
    assert [line.partition("#")[2] for line in new.splitlines() if "#" in line] == [
        line.partition("#")[2] for line in text.splitlines() if "#" in line
    ]


@pytest.mark.parametrize("text", ["[limits]\nn = 3\n", "[[limits]]\nn = 3\n", "limits = 3\n"])
def test_what_is_no_table_is_not_edited(text):
    with pytest.raises(InputError, match="cannot edit"):
        put(text, "limits.n.upper", "2 rpm")


def test_a_missing_table_between_tables_that_are_apart_is_added():
    text = "[a.x]\nk = 1\n[b]\nk = 1\n[a.y]\nk = 1\n"
    assert tomllib.loads(put(text, "a.z.k", 2)) == {
        "a": {key: {"k": 1} for key in "xyz"} | {"z": {"k": 2}},
        "b": {"k": 1},
    }


def test_malformed_text_is_refused():
    with pytest.raises(InputError, match="malformed"):
        put("[a\n", "a.b", 1)


def test_a_removed_table_stays_as_a_comment_at_the_end():
    text = "[a]\nx = 1\n\n# of c\n[c]\nx = 3  # three\n"
    assert with_values(text, {("a",): None}) == "\n# of c\n[c]\nx = 3  # three\n\n# [a]\n# x = 1\n"
    text = "[a.b]\nx = 1\n# of a.c\n[a.c]\ny = 2\n# of d\n[d]\nx = 3\n"
    assert with_values(text, {("a", "c"): None}) == ("[a.b]\nx = 1\n# of a.c\n# of d\n[d]\nx = 3\n\n# [a.c]\n# y = 2\n")


def test_a_table_is_replaced_whole_and_a_new_one_joins_its_kind():
    files = [{"path": "a.csv", "channels": {"u": {"column": "v", "unit": "m/s"}}}]
    text = '[import]\nfit = ["a"]\n[[import.files]]\npath = "b.csv"  # gone\n\n# of the design\n[design]\nx = 1\n'
    new = with_values(text, {("import", "files"): files, ("design",): {"y": 2}})
    assert tomllib.loads(new) == {"import": {"fit": ["a"], "files": files}, "design": {"y": 2}}
    assert 'channels.u = {column = "v", unit = "m/s"}\n\n# of the design\n[design]\n' in new
    text = "[prior.a]\nx = 1\n\n# limits\n[limits.n]\nx = 2\n"
    assert put(text, "prior.b", {"x": 3}) == "[prior.a]\nx = 1\n\n[prior.b]\nx = 3\n\n# limits\n[limits.n]\nx = 2\n"


@pytest.mark.parametrize("template", ["remus100", "log"])
def test_the_files_that_init_writes_can_be_edited(tmp_path, template):
    text = init_campaign(tmp_path / template, template).read_text()
    new = put(text, "limits.n.upper", "1400 rpm")
    assert tomllib.loads(new)["limits"]["n"]["upper"] == "1400 rpm"
    assert [line for line in text.splitlines() if line.startswith("#")] == [
        line for line in new.splitlines() if line.startswith("#")
    ]
    mapped = with_map(tmp_path, text, "run 1", [{"path": "a.csv", "channels": {}}])
    content = tomllib.loads(mapped)
    assert content["import"]["fit"] == ["run 1"]
    assert "truth" not in content
    trimmed = tomllib.loads(with_trim(tmp_path, mapped, None, "1.5 s", None))
    assert trimmed["import"]["start"] == "1.5 s"
    assert "end" not in trimmed["import"]
    own = tomllib.loads(with_trim(tmp_path, mapped, "25_05", "1.5 s", "9 s"))
    assert own["import"]["trim"] == {"25_05": {"start": "1.5 s", "end": "9 s"}}


@pytest.mark.parametrize("run", ["run 1", "jour 1 été", "1.5", 'a "b" c', "a]b #c", "a'b"])
def test_a_run_of_any_name_is_cut_and_cut_again(tmp_path, run):
    text = f"[import]\nfit = [{json.dumps(run)}]\n\n# of the run\n[design]\nduration = '9 s'\n"
    once = with_trim(tmp_path, text, run, "1.5 s", None)
    twice = with_trim(tmp_path, once, run, "2 s", "9 s")
    assert tomllib.loads(twice)["import"]["trim"] == {run: {"start": "2 s", "end": "9 s"}}
    assert all(f"{line}\n" in twice for line in text.splitlines())
    assert twice.count("[import.trim.") == 1


@pytest.mark.parametrize(
    "channel_map",
    [
        "",
        "[[import.files",
        "import = 3",
        '[[import.files]]\npath = "/etc/passwd"',
        '[[import.files]]\npath = "../other/a.csv"',
        '[[import.files]]\npath = "~/a.csv"',
        '[[import.files]]\npath = "$HOME/a.csv"',
        '[[import.files]]\npath = "{run}"',
        '[[import.files]]\npath = "link.csv"',
        '[[import.files]]\npath = "a.csv"\nchannels.u = {column = "u", curve = "/etc/passwd"}',
        '[[import.files]]\npath = "a.csv"\nchannels.u = {column = "u", curve = "../other/a.csv"}',
        '[[import.files]]\npath = "a.csv"\nchannels.u = {column = "u", curve = "~/a.csv"}',
        '[[import.files]]\npath = "a.csv"\nchannels.u = {column = "u", curve = "$HOME/a.csv"}',
        '[[import.files]]\npath = "a.csv"\nchannels.u = {column = "u", curve = "link.csv"}',
        '[[import.files]]\npath = "a\\u0000.csv"',
        '[[import.files]]\npath = "a.csv"\nchannels = 3',
        '[[import.files]]\npath = "a.csv"\n[goal]\ntrials = 9',
        '[import]\nstart = "1 s"\n[[import.files]]\npath = "a.csv"',
        "[[import.files]]\nchannels = {}",
    ],
)
def test_a_map_from_the_page_names_logs_of_its_campaign_and_nothing_else(tmp_path, channel_map):
    (tmp_path / "boat").mkdir()
    (tmp_path / "boat" / "link.csv").symlink_to("/etc/passwd")
    with pytest.raises(InputError, match="channel map"):
        with_map(tmp_path / "boat", TEXT, "../other", typed_map(channel_map))


def test_a_file_changed_meanwhile_is_not_overwritten(tmp_path):
    (tmp_path / "campaign.toml").write_text(TEXT)
    seen = read_file(tmp_path)
    (tmp_path / "campaign.toml").write_text(TEXT + "# somebody else\n")
    with pytest.raises(InputError, match="changed after it was read"):
        write_file(tmp_path, "new", seen)
    write_file(tmp_path, "new", read_file(tmp_path))
    assert read_file(tmp_path) == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["campaign.toml"]
