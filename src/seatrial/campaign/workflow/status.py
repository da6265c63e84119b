"""What of a campaign is current, stale or missing; nothing is computed, and of large results only the stamp is read."""

from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import Trials, record_key, trials_key
from seatrial.campaign.data.simulate import record_keys
from seatrial.campaign.design.sweep import design_key
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.predict import Fit
from seatrial.campaign.selection.evidence import evidence_key
from seatrial.campaign.selection.screening import screening_key, with_shortlist
from seatrial.campaign.store.files import Store, key_of, stamp_of
from seatrial.core.dataset_file import stored
from seatrial.core.errors import InputError
from seatrial.logs.formats.registry import hash_of_log

State = Literal["current", "stale", "missing"]


class Step(NamedTuple):
    """One step of a campaign: its name, whether its results are current, and the command that makes them so."""

    name: str
    state: State
    command: str


def standing(folder: Path) -> tuple[Step, ...]:
    """Say of every step whether its results belong to the campaign file and logs as they are now.

    Raises:
        InputError: a campaign file that cannot be used.
    """
    campaign, store = load_campaign(folder), Store(folder)
    design = Step("design", _state(store.design, lambda: design_key(campaign)), "design")
    steps = [design] if campaign.imports is None or design.state != "missing" else []
    trials, state = _trials(campaign)
    records = "simulate" if campaign.is_simulated else "import"
    steps.append(Step(records, state, records))
    return (*steps, *_after(campaign, store, trials if state == "current" else None))


def _trials(campaign: Campaign) -> tuple[Trials, State]:
    """Key of the records, and the gravest of their states; a log that is missing makes its record stale."""
    store, imports = Store(campaign.folder), campaign.imports
    if not campaign.has_records:
        return Trials((), (), ""), "missing"
    if imports is None:
        keys = record_keys(campaign)
        states = [_state(store.record(label), lambda key=key: key) for label, key in keys.items()]
        return Trials((), (), list(keys.values())[-1]), _gravest(states)
    keys = {}
    for run in imports.runs:
        try:
            keys[run] = record_key(campaign, imports, run, _hash_of)
        except InputError:
            keys[run] = ""
    states = [_state(store.record(run), lambda run=run: keys[run]) for run in imports.runs]
    return Trials((), (), trials_key(imports, list(keys.values()))), _gravest(states)


def _after(campaign: Campaign, store: Store, trials: Trials | None) -> Iterator[Step]:
    """Steps that need the records; none of them is current while those are not."""
    if trials is not None and campaign.is_large:
        fresh = _stamp(store.screening) == screening_key(campaign, trials)
        if fresh:
            campaign = with_shortlist(campaign, trials)
        else:
            trials = None
    if trials is None:
        made = {
            "estimate": any((store.results / "posterior").glob("*.nc")),
            "select": store.selection.is_file(),
            "predict": store.predictions.is_file(),
            "next": store.next_design.is_file(),
            "report": store.report.is_file(),
        }
        yield from (Step(name, "stale" if there else "missing", _COMMAND[name]) for name, there in made.items())
        return
    keys = {one.label: estimate_key(campaign, one, trials) for one in campaign.structures}
    estimated = _gravest([_state(store.posterior(label), lambda key=key: key) for label, key in keys.items()])
    yield Step("estimate", estimated, _COMMAND["estimate"])
    evidences = {one.label: evidence_key(campaign, one, trials) for one in campaign.structures}
    selected = _state(store.selection, lambda: key_of("selection", evidences))
    yield Step("select", selected, _COMMAND["select"])
    known = [name.name for name in fields(Fit)]
    chosen = [key_of("predictions", known, key, trials.key) for key in keys.values()]
    yield Step("predict", _among(store.predictions, chosen, selected), _COMMAND["predict"])
    nexts = [key_of("next", design_key(campaign), keys[one.label], one.terms) for one in campaign.structures]
    yield Step("next", _among(store.next_design, nexts, selected), _COMMAND["next"])
    yield Step("report", _report(store, key_of("summary", list(keys.values())), selected), _COMMAND["report"])


_COMMAND = {"estimate": "estimate", "select": "select", "predict": "run", "next": "next", "report": "report"}


def _report(store: Store, key: str, selected: State) -> State:
    """The page is as current as the summary it was drawn from, if it is not older."""
    if not store.report.is_file():
        return "missing"
    fresh = selected == "current" and _stamp(store.summary) == key
    return "current" if fresh and store.report.stat().st_mtime >= store.summary.stat().st_mtime else "stale"


def _among(path: Path, keys: list[str], selected: State) -> State:
    """State of a result of the chosen structure, whichever that is; stale where the choice itself is."""
    if not path.is_file():
        return "missing"
    return "current" if selected == "current" and _stamp(path) in keys else "stale"


def _state(path: Path, key: Callable[[], str]) -> State:
    if not path.is_file():
        return "missing"
    return "current" if _stamp(path) == key() else "stale"


def _gravest(states: list[State]) -> State:
    if "stale" in states or ("missing" in states and "current" in states):
        return "stale"
    return "missing" if "missing" in states else "current"


def _stamp(path: Path) -> str | None:
    """Key of a result. Of a large file the stamp alone is read: whether its content is sound is asked when it is used."""
    if path.suffix != ".nc":
        return stamp_of(path)
    try:
        with stored(path) as file:
            key = file.attrs.get("key")
            return key.decode() if isinstance(key, bytes) else None if key is None else str(key)
    except InputError:
        return None


def _hash_of(path: Path) -> str:
    """Hash of a log, kept while its size and time of change stay."""
    if not path.is_file():
        return hash_of_log(path)
    there = path.stat()
    return _hashed(path, there.st_size, there.st_mtime_ns)


@lru_cache(maxsize=256)
def _hashed(path: Path, size: int, changed: int) -> str:
    del size, changed  # part of the key only
    return hash_of_log(path)
