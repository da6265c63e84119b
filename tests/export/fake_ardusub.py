"""An ArduSub made of its documents: it talks MAVLink over UDP on the loopback, and moves as its sticks say.

MANUAL_CONTROL as in ArduSub/joystick.cpp and GCS_MAVLink_Sub.cpp: only of its ground station and aimed at it; pulses of
1500 + 400 gain x / 1000 for x, y and r, and 1500 + 800 gain (z - 500) / 1000 for z; forgotten after RC_OVERRIDE_TIME, 3 s.
Motors turn in mode MANUAL while it is armed: forward, starboard, up and to starboard for pulses above 1500.
"""

import threading
import time
from dataclasses import dataclass, field

from pymavlink import mavutil

ARM, SET_MODE, SET_ACTUATOR = 400, 176, 187
MANUAL, ALT_HOLD = 19, 2


@dataclass
class Habits:
    """How it behaves; times count from the first stick that is not at rest."""

    mode: int = MANUAL
    armed: bool = False
    answer: int | None = 0
    arms: bool = True
    arms_itself_after: float | None = None
    owner: int = 255
    silent_after: float | None = None
    disarms_after: float | None = None
    changes_mode_after: float | None = None
    fails_after: float | None = None
    switches: dict[str, float] = field(default_factory=dict)
    second: bool = False
    kind: tuple[int, int] = (3, 12)


class FakeSub(threading.Thread):
    """It runs until it is closed; `moves` holds what its motors did, as (time, forward, starboard, down, yaw to starboard)."""

    def __init__(self, port: int, habits: Habits) -> None:
        """Open the link to a port that the other side listens to."""
        super().__init__(daemon=True)
        self.habits = habits
        self.armed, self.mode = habits.armed, habits.mode
        self.link, self.companion, self.other = (
            mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=system, source_component=component)
            for system, component in ((1, 1), (1, 191), (2, 1))
        )
        self.moves: list[tuple[float, ...]] = []
        self.sticks: list[tuple[int, ...]] = []
        self.beats_heard, self.commands = 0, []
        self.started = self.moving_since = None
        self.going = True

    def run(self) -> None:
        """Heartbeats every 50 ms, answers at once."""
        self.started, beat = time.monotonic(), 0.0
        while self.going:
            now = time.monotonic()
            if self._after(self.habits.disarms_after):
                self.armed = False
            if self._after(self.habits.changes_mode_after):
                self.mode = ALT_HOLD
            itself = self.habits.arms_itself_after
            if itself is not None and now > self.started + itself and self.moving_since is None:
                self.armed = True
            if now > beat + 0.05:
                beat = now
                self._beat()
            self._listen()
            time.sleep(0.002)

    def close(self) -> None:
        """End it."""
        self.going = False
        self.join()
        for link in (self.link, self.companion, self.other):
            link.close()

    @property
    def silent(self) -> bool:
        """Whether its autopilot has fallen silent."""
        return self._after(self.habits.silent_after)

    def _after(self, seconds: float | None) -> bool:
        return seconds is not None and self.moving_since is not None and time.monotonic() > self.moving_since + seconds

    def _beat(self) -> None:
        # A companion computer in the same system, whose flags happen to say "armed", as those of some cameras do.
        self.companion.mav.heartbeat_send(18, 8, 128, 0, 4)
        if self.habits.second:
            self.other.mav.heartbeat_send(12, 3, 0, MANUAL, 3)
        if self.silent:
            return
        autopilot, kind = self.habits.kind
        state = 5 if self._after(self.habits.fails_after) else 4 if self.armed else 3
        self.link.mav.heartbeat_send(kind, autopilot, 1 | (128 if self.armed else 0), self.mode, state)
        for name, value in self.habits.switches.items():
            self.link.mav.named_value_float_send(0, name.encode(), value)

    def _listen(self) -> None:
        while (message := self.link.recv_match(blocking=False)) is not None:
            if self.silent:
                continue
            kind = message.get_type()
            if kind == "HEARTBEAT":
                self.beats_heard += 1
            elif kind == "COMMAND_LONG":
                self._obey(message)
            elif kind == "MANUAL_CONTROL" and message.get_srcSystem() == self.habits.owner and message.target == 1:
                self._steer(message)
            elif kind == "PARAM_REQUEST_READ" and message.param_id == "SYSID_MYGCS":
                self.link.mav.param_value_send(b"SYSID_MYGCS", self.habits.owner, 4, 1, 0)

    def _obey(self, message) -> None:
        self.commands.append((message.command, message.param1))
        if self.habits.answer is None:
            return
        if self.habits.answer == 0 and message.command == ARM:
            self.armed = bool(message.param1) and self.habits.arms
        if self.habits.answer == 0 and message.command == SET_MODE:
            self.mode = int(message.param2)
        if self.habits.answer == 0 and message.command == SET_ACTUATOR:
            self.sticks.append((message.param1,))
            self._note_motion(message.param1 != 0)
        self.link.mav.command_ack_send(message.command, self.habits.answer)

    def _steer(self, message) -> None:
        self.sticks.append((message.x, message.y, message.z, message.r))
        gain = 0.5
        pulses = [1500 + round(0.4 * gain * value) for value in (message.x, message.y, message.r)]
        up = 1500 - round(400 * gain) + round(0.8 * gain * message.z)
        forward, starboard, yaw = ((pulse - 1500) / 400 for pulse in pulses)
        moving = (forward, starboard, -(up - 1500) / 400, yaw)
        self._note_motion(any(moving))
        self.moves.append((time.monotonic(), *(moving if self.armed and self.mode == MANUAL else (0.0,) * 4)))

    def _note_motion(self, moves: bool) -> None:
        if moves and self.moving_since is None:
            self.moving_since = time.monotonic()
