"""What was said of a campaign and may be said again: an answer, kept with the hash of every file that it rests on.

A result says by its key what it was computed from, and to find that key the whole campaign has to be read. An answer says the same by
bytes: while the campaign file, its logs and the results are what they were, so is what a command says of them, and nothing else needs to
be read or loaded. Whatever differs, the command runs, and its steps find by their keys what is to be done.

Source: Mokhov, Mitchell and Peyton Jones (2018), Build Systems à la Carte, section 4.2, where this is called a constructive trace.
"""

import hashlib
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from seatrial.campaign.store.stored_result import Store, key_of, read_json, write_stamped_json
from seatrial.core.errors import InputError
from seatrial.core.files import Look, look_of, sha256_of, sha256_of_json


def key_of_answer(folder: Path, text: str, asked: Mapping[str, Any]) -> str:
    """Return the key of an answer, by which it is found again: of all that it depends on beside files.

    Args:
        folder: of the campaign; answers name files as they were asked for.
        text: of the campaign file, in which paths may hold variables of the environment.
        asked: command and options, JSON-able.
    """
    return key_of("answer", str(folder.resolve()), os.path.expandvars(text), os.environ.get("HOME", ""), asked)


def recall(path: Path, key: str) -> Any | None:
    """Return an answer that was kept with this key; None if there is none, or a file is not what it was."""
    try:
        kept = read_json(path, "seatrial run")
        same = kept["key"] == key and all(_is_as_then(Path(file), then) for file, then in kept["rests_on"].items())
        return kept["answer"] if same else None
    except (InputError, OSError, KeyError, AttributeError):
        return None


def latest(path: Path) -> tuple[Any, bool] | None:
    """Return the answer kept last, however it was asked for, and whether its files are what they were; None if there is none."""
    try:
        kept = read_json(path, "seatrial run")
        return kept["answer"], all(_is_as_then(Path(file), then) for file, then in kept["rests_on"].items())
    except (InputError, OSError, KeyError, AttributeError):
        return None


def keep(path: Path, key: str, answer: Any, seen: Mapping[Path, Look]) -> None:
    """Keep an answer, unless a file was changed by others while it was made, or the folder cannot be written to.

    Args:
        path: where; see `Store.answer`.
        key: of `key_of_answer`.
        answer: JSON-able.
        seen: files that it rests on, from `watching_files`; other answers are none of them, nor checkpoints, which do not stay.
    """
    passing = {path.parent.absolute(), Store(path.parents[2]).checkpoint("any").parent.absolute()}
    rests_on = {file: look for file, look in seen.items() if file.parent not in passing}
    if any(look_of(file) != look for file, look in rests_on.items()):
        return
    with suppress(OSError):
        hashes = {str(file): _hash(file) for file in sorted(rests_on)}
        write_stamped_json(path, {"rests_on": hashes, "answer": answer}, key)


def _is_as_then(path: Path, then: str | None) -> bool:
    """Return whether a file has the hash that it had, or it is the table of coefficients, to which probabilities were added."""
    if _hash(path) == then:
        return True
    if path != Store(path.parent.parent).coefficients or not path.is_file():
        return False
    heading, line_end, rows = path.read_bytes().partition(b"\n")
    before = re.sub(rb"(?m)^([^,\n]*),[^,\n]*", rb"\1,", rows)
    return hashlib.sha256(heading + line_end + before).hexdigest() == then


def _hash(path: Path) -> str | None:
    """Return the hash of a file's bytes, of a folder's names; None if there is neither, or it cannot be read."""
    try:
        if path.is_dir():
            return sha256_of_json(sorted(os.listdir(path)))
        return sha256_of(path) if path.is_file() else None
    except (OSError, ValueError):
        return None
