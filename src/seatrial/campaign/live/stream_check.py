"""The stream judged as `seatrial check` judges a record: over its last minute, every few seconds.

What is found twice in a row is a fault, until the same check has passed for a minute: advice that changes with each look helps nobody.
Of a channel the first fault is told alone: a wrong unit may look like a wrong sign as well.
"""

from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.check import motion_findings
from seatrial.compiled.batching import bucket_length
from seatrial.core.record import Channel, Provenance, Record
from seatrial.core.signals import signal_unit
from seatrial.logs.measured_control import looks_measured
from seatrial.messages.render import remedy, statement

ROW_SECONDS = 0.1  # Seconds between two rows of what is judged, at least
JUDGED_SECONDS = 60.0  # Seconds that are judged
FIRST_SECONDS = 10.0  # Seconds before which nothing is
OFTEN = 5.0  # Seconds between two judgements
# Seconds before which the direction is not judged: until then the expected motion is led by its start, in whatever
# unit that came
LED = 30.0
# Judgements in a row that find a fault before it is one, and that pass before it is none: until all that is judged is
# new
FOUND, GONE = 2, round(JUDGED_SECONDS / OFTEN)
PART_ROWS = bucket_length(round(JUDGED_SECONDS / ROW_SECONDS) + 1)  # Rows to which every part of a stream is filled up
CONTROL_SAMPLES = 600  # Latest samples of a control that show whether it looks measured
# Levels of each check with which no goal is met; of a channel the first check that fails is told
GRAVE_LEVELS = {"direction-reversed": ("alarm",), "axes-wrong": ("alarm",), "size-unlike": ("caution",)}


class StreamCheck:
    """What is wrong with a stream.

    Args:
        campaign: whose priors and trim say what is expected.
        lined: controls that are taken as straight lines between their samples.
        say: told what is found, once.
    """

    def __init__(self, campaign: Campaign, lined: set[str], say: Callable[[str, str], None]):
        self.campaign, self.say = campaign, say
        self.controls, self.measured = campaign.model(campaign.full).controls, campaign.channels
        self.rows: deque[tuple[float, dict[str, float]]] = deque()
        self.fresh: dict[str, float] = {}
        self.judged = 0.0
        self.looks: dict[tuple[str, str], int] = {}
        """Judgements in a row that found something, by channel and check; below 0 those that passed."""
        self.faults: dict[tuple[str, str], str] = {}
        """What is wrong, in words, likewise."""
        held = [name for name in self.controls if name not in lined]
        self.sent = {name: deque[tuple[float, float]](maxlen=CONTROL_SAMPLES) for name in held}

    def warm(self) -> None:
        """Compile what is needed before the first sample comes."""
        time = np.arange(3) * ROW_SECONDS
        trim = [self.campaign.hull.trim.get(name, 0.0) for name in self.controls]
        motion_findings(
            self.campaign,
            self._record(time, np.tile(trim, (3, 1)), np.full((3, len(self.measured)), np.nan)),
            PART_ROWS,
        )

    def begin(self) -> None:
        """Forget the samples before a gap or a restart; what was found stays."""
        self.rows.clear()
        self.fresh.clear()
        for sent in self.sent.values():
            sent.clear()

    def add(self, time: float, control: Mapping[str, float], values: Mapping[str, float]) -> None:
        """Add one sample.

        Args:
            time: s, increasing.
            control: every control that holds from now on, SI.
            values: of the channels that came with it, SI.
        """
        for name, sent in self.sent.items():
            if name in values:
                sent.append((time, values[name]))
        self.fresh |= {name: values[name] for name in self.measured if name in values}
        if self.rows and time - self.rows[-1][0] < ROW_SECONDS * (1 - 1e-6):
            return
        self.rows.append((time, {**control, **self.fresh}))
        self.fresh = {}
        while self.rows[0][0] < time - JUDGED_SECONDS:
            self.rows.popleft()

    def judge(self) -> list[str]:
        """Return what is wrong with the stream, in words; it is looked for every few seconds."""
        if (
            self.rows
            and (now := self.rows[-1][0]) - self.rows[0][0] >= FIRST_SECONDS
            and not 0 <= now - self.judged < OFTEN
        ):
            self.judged = now
            self._judge()
            self._judge_controls()
        return list(self.faults.values())

    def _judge(self) -> None:
        time = np.array([one for one, _ in self.rows])
        control, measured = (
            np.array([[row.get(name, np.nan) for name in names] for _, row in self.rows])
            for names in (self.controls, self.measured)
        )
        record = self._record(time - time[0], control, measured)
        findings = motion_findings(self.campaign, record, PART_ROWS)
        for code, levels in GRAVE_LEVELS.items():
            if code == "direction-reversed" and record.time[-1] < LED:
                continue
            for one in (one for one in findings if one.code == code):
                signal = ", ".join(one.subject)
                key = (signal, code)
                seen = self.looks.get(key, 0)
                if one.level in levels:
                    self.looks[key] = seen = max(seen, 0) + 1
                elif one.level == "pass":
                    self.looks[key] = seen = min(seen, 0) - 1
                if seen >= FOUND and signal not in {other for other, _ in self.faults}:
                    self.faults[key] = f"{remedy(one)} ({statement(one)})"
                    self.say(" ".join(key), self.faults[key])
                elif seen <= -GONE:
                    self.faults.pop(key, None)

    def _judge_controls(self) -> None:
        measured = [name for name, sent in self.sent.items() if len(sent) and looks_measured(*np.array(sent).T)]
        for name in measured:
            del self.sent[name]
        if measured:
            self.say(
                f"measured {measured[0]}",
                f"controls that change at nearly every sample are used as steps: {', '.join(measured)}. If they are measurements, not "
                f'commands, write between = "line" for the column, as in channels.{measured[0]}, under '
                f"[[import.files]]",
            )

    def _record(self, time: np.ndarray, control: np.ndarray, measured: np.ndarray) -> Record:
        channels = [Channel(name, signal_unit(name), "control") for name in self.controls]
        channels += [Channel(name, signal_unit(name), "measurement") for name in self.measured]
        return Record(time, control, measured, tuple(channels), Provenance("stream", ""), "stream")
