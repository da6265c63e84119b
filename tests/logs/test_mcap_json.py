"""Recordings of BlueOS: MAVLink as JSON in MCAP, with its words, its map, and what happens when the power is cut."""

import json
from pathlib import Path

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.registry import catalogue, read_columns
from seatrial.logs.guess import best
from seatrial.logs.inspect import inspect_log
from tests.logs.log_writers import ROWS, STAMPS, SURGE, json_mcap, mavlink_json

MODES = ["MANUAL" if k < 10 else "ALT_HOLD" for k in range(ROWS)]


def voyage():
    """Messages of an ROV as the recorder gets them; the mode in the words of a message of our own."""
    found = []
    for k in range(ROWS):
        time, boot, angle = int(STAMPS[k]), 20 * k, 0.3 * np.sin(0.2 * k)
        pwm = {f"servo{i}_raw": 1500 + (100 * (-1) ** k if i <= 8 else 0) * (i % 3) for i in range(1, 17)}
        pwm["servo4_raw"] = 1500 + 50 * (-1) ** k
        pwm |= {f"servo{i}_raw": 1500 + 7 * i * (-1) ** k for i in range(1, 9)}
        found += [
            (
                "mavlink/1/1/ATTITUDE",
                time,
                mavlink_json(
                    "ATTITUDE",
                    time_boot_ms=boot,
                    roll=0.1 * angle,
                    pitch=0.2 * angle,
                    yaw=angle,
                    rollspeed=0.01 * k,
                    pitchspeed=0.02 * angle,
                    yawspeed=0.1 * angle,
                ),
            ),
            (
                "mavlink/1/1/SERVO_OUTPUT_RAW",
                time + 1000,
                mavlink_json("SERVO_OUTPUT_RAW", time_usec=boot * 1000, port=0, **pwm),
            ),
            (
                "mavlink/1/1/LOCAL_POSITION_NED",
                time + 2000,
                mavlink_json(
                    "LOCAL_POSITION_NED",
                    time_boot_ms=boot,
                    x=0.1 * k,
                    y=0.2 * k,
                    z=1.0 + 0.01 * k,
                    vx=float(SURGE[k]),
                    vy=0.1 * angle,
                    vz=0.01 * k,
                ),
            ),
            (
                "mavlink/1/1/HEARTBEAT",
                time + 3000,
                mavlink_json(
                    "HEARTBEAT",
                    custom_mode=19 if k < 10 else 2,
                    mavtype={"type": "MAV_TYPE_SUBMARINE"},
                    base_mode={"bits": 217},
                ),
            ),
            ("vehicle/mode", time + 4000, {"mode": MODES[k], "armed": k > 2, "volts": None if k == 3 else 15.5}),
        ]
    return found


def check(path):
    tables = {table.name: table for table in catalogue(LogFile(path))}
    assert set(tables) == {topic for topic, _, _ in voyage()}
    assert tables["vehicle/mode"].words == ("mode",)
    assert tables["mavlink/1/1/HEARTBEAT"].words == ("message.type", "message.mavtype.type")
    raw = read_columns(LogFile(path), "vehicle/mode", ["mode", "armed", "volts", "log_time"], ["log_time"], ["mode"])
    assert raw.columns["mode"].tolist() == MODES
    np.testing.assert_array_equal(raw.columns["armed"], np.arange(ROWS) > 2)
    np.testing.assert_array_equal(raw.columns["log_time"], STAMPS + 4000)
    assert np.isnan(raw.columns["volts"]).tolist() == [k == 3 for k in range(ROWS)]
    found = {guess.channel: guess for guess in best(inspect_log(path).guesses)}
    attitude, pwm, local = (f"mavlink/1/1/{name}" for name in ("ATTITUDE", "SERVO_OUTPUT_RAW", "LOCAL_POSITION_NED"))
    expected = {
        "phi": (attitude, "roll"),
        "psi": (attitude, "yaw"),
        "r": (attitude, "yawspeed"),
        "z": (local, "z"),
        "v_north": (local, "vx"),
    }
    for channel, (table, column) in expected.items():
        assert (found[channel].table, found[channel].column) == (table, f"message.{column}"), channel
    thrusters = [channel for channel in found if channel.startswith("f_")]
    assert thrusters == [f"f_{i}" for i in range(1, 9)]
    assert all(found[one].table == pwm for one in thrusters)


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_words_numbers_and_the_map_of_a_recording(tmp_path, compression):
    check(json_mcap(tmp_path / "recorder.mcap", voyage(), compression))


def test_the_map_of_a_recording_by_the_library_of_mcap(tmp_path):
    writer = pytest.importorskip("mcap.writer")
    with (tmp_path / "recorder.mcap").open("wb") as stream:
        made = writer.Writer(stream)
        made.start(profile="", library="test")
        channels = {}
        for topic, time, content in voyage():
            if topic not in channels:
                schema = made.register_schema(topic.replace("/", "."), "jsonschema", b'{"type": "object"}')
                channels[topic] = made.register_channel(topic, "json", schema)
            made.add_message(channels[topic], log_time=time, publish_time=time, data=json.dumps(content).encode())
        made.finish()
    check(tmp_path / "recorder.mcap")


def test_a_recording_whose_power_was_cut_is_read_to_its_last_whole_chunk(tmp_path):
    whole = json_mcap(tmp_path / "whole.mcap", voyage(), chunk=10)
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) * 3 // 4])
    tables = catalogue(LogFile(cut))
    assert 0 < tables[0].rows < ROWS
    assert "was cut off" in tables[0].notes[0]
    raw = read_columns(LogFile(cut), "vehicle/mode", ["mode"], (), ["mode"])
    assert raw.columns["mode"].tolist() == MODES[: len(raw.columns["mode"])]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda data: data.replace(b"{", b"[", 3), "no JSON"),
        (lambda data: data[:60] + b"\xff" * 8 + data[68:], "cannot be read"),
    ],
)
def test_damage_is_said(tmp_path, damage, message):
    path = json_mcap(tmp_path / "recorder.mcap", voyage()[:20], "")
    path.write_bytes(damage(path.read_bytes().replace(b'{"type": "object"}', b'("type": "object")')))
    with pytest.raises(InputError, match=message):
        catalogue(LogFile(Path(path)))


def test_messages_in_another_encoding_are_listed_as_such(tmp_path):
    path = json_mcap(tmp_path / "recorder.mcap", voyage()[:20], "")
    path.write_bytes(path.read_bytes().replace(b"\x04\x00\x00\x00json", b"\x04\x00\x00\x00cbor"))
    assert {table.trouble for table in catalogue(LogFile(path))} == {
        'messages in the encoding "cbor"; only JSON is read'
    }
