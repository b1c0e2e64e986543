"""ArduPilot's log written by a test: the rows of a DataFlash file as the autopilot writes them."""

import math
import struct
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.files.tlog import decode_record, records

HEAD = b"\xa3\x95"
FMT = 128
FORMATS = {
    "VER": ("QBBHBBB", "TimeUS,BU,Maj,FV,Min,Pat,X"),
    "MSG": ("QZ", "TimeUS,Message"),
    "ATT": ("Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "XKF1": ("QBccCffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD"),
    "XKF4": ("QBIb", "TimeUS,C,SS,PI"),
    "MODE": ("QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "ARM": ("QB", "TimeUS,ArmState"),
    "EV": ("QB", "TimeUS,Id"),
    "ERR": ("QBB", "TimeUS,Subsys,ECode"),
    "RCIN": ("Q" + "H" * 14, "TimeUS," + ",".join(f"C{n}" for n in range(1, 15))),
    "TSYN": ("QBQ", "TimeUS,SysID,RTT"),
}
"""Name -> field types and names, as FMT rows give them (a part of the real ones)."""
PACKED = {
    "B": "B",
    "b": "b",
    "M": "B",
    "H": "H",
    "c": "h",
    "C": "H",
    "I": "I",
    "f": "f",
    "Q": "Q",
    "Z": "64s",
}
GOOD, HELD = 0b0_0011_1111, 0b0_1000_0001
"""XKF4.SS of an estimator with a position, and of one that assumes a constant one."""

Row = tuple[str, tuple[float | int | bytes, ...]]


def write_log(path: Path, rows: list[Row]) -> Path:
    """A log of rows (name, values in the order of its format)."""
    names = list(FORMATS)
    data = b""
    for number, name in enumerate(names):
        types, columns = FORMATS[name]
        length = 3 + struct.calcsize("<" + "".join(PACKED[t] for t in types))
        data += HEAD + bytes([FMT])
        data += struct.pack(
            "<BB4s16s64s", number + 1, length, name.encode(), types.encode(), columns.encode()
        )
    for name, values in rows:
        layout = "<" + "".join(PACKED[t] for t in FORMATS[name][0])
        data += HEAD + bytes([names.index(name) + 1]) + struct.pack(layout, *values)
    path.write_bytes(data)
    return path


def rows_of_tlog(path: Path) -> list[Row]:
    """The attitudes, gyro samples and velocities of a tlog, and a vehicle armed in GUIDED, as ArduPilot logs them."""
    rows: list[Row] = []
    data = path.read_bytes()
    for record in records(data):
        m = decode_record(data, record)
        name = m.get_type()
        if name == "ATTITUDE":
            roll, pitch, yaw = (math.degrees(angle) for angle in (m.roll, m.pitch, m.yaw))
            rows.append(("ATT", (m.time_boot_ms * 1000 + 500, 0, roll, 0, pitch, 0, yaw % 360)))
        elif name == "RAW_IMU":
            rate = (m.xgyro * 1e-3, m.ygyro * 1e-3, m.zgyro * 1e-3)
            force = (m.xacc * 9.80665e-3, m.yacc * 9.80665e-3, m.zacc * 9.80665e-3)
            rows.append(("IMU", (m.time_usec, 0, *rate, *force)))
        elif name == "LOCAL_POSITION_NED":
            values = (m.vx, m.vy, m.vz, m.x, m.y, m.z)
            rows.append(("XKF1", (m.time_boot_ms * 1000 + 500, 0, 0, 0, 0, *values)))
    first_us = min(int(values[0]) for _, values in rows)
    before = [
        ("VER", (first_us, 2, 4, 2, 7, 0, 0)),
        ("MODE", (first_us, mavlink.COPTER_MODE_GUIDED, mavlink.COPTER_MODE_GUIDED, 2)),
        ("MSG", (first_us, b"Arming motors")),
        ("EV", (first_us, 28)),
    ]
    return [*before, *sorted(rows, key=lambda row: row[1][0])]
