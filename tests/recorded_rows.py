"""Files of a live bench in Python tests: their rows, and whether telemetry.h5 has the same to the last bit."""
import struct

import h5py
import numpy

from harness import check, path
from mcap_file import Mcap

# The channels for which a JointState has fields, in their order.
OF_JOINT_STATE = ("position_rad", "velocity_rad_s", "torque_nm")


class Cdr:
    """A message of ROS 2 (XCDR1, little endian)."""

    def __init__(self, data):
        assert data[:4] == b"\0\1\0\0", data[:4]
        self.data, self.at = data[4:], 0

    def take(self, kind, count=1):
        size = struct.calcsize(kind)
        self.at += -self.at % size
        self.at += size * count
        return struct.unpack(f"<{count}{kind}", self.data[self.at - size * count : self.at])

    def text(self):
        (size,) = self.take("I")
        return b"".join(self.take("c", size))[:-1].decode()

    def texts(self):
        return [self.text() for _ in range(self.take("I")[0])]

    def doubles(self):
        (count,) = self.take("I")
        return self.take("d", count) if count else ()

    def header(self):
        seconds, nanoseconds = self.take("i")[0], self.take("I")[0]
        self.text()
        return seconds * 10**9 + nanoseconds


def rows_of_mcap(name):
    """Times [ns], and numbers by (joint, channel)."""
    file = Mcap(path(name))
    topics = {channel[1]: file.messages.get(number, []) for number, channel in file.channels.items()}
    columns, times = {}, [t for t, _ in topics["/joint_states"]]
    for logged, data in topics["/joint_states"]:
        message = Cdr(data)
        assert message.header() == logged
        joints = message.texts()
        for channel in OF_JOINT_STATE:
            for joint, value in zip(joints, message.doubles()):
                columns.setdefault((joint, channel), []).append(value)
    assert [t for t, _ in topics["/dynamic_joint_states"]] == times
    for logged, data in topics["/dynamic_joint_states"]:
        message = Cdr(data)
        assert message.header() == logged
        joints = message.texts()
        assert message.take("I")[0] == len(joints)
        for joint in joints:
            for channel, value in zip(message.texts(), message.doubles()):
                columns.setdefault((joint, channel), []).append(value)
    return numpy.array(times), {key: numpy.array(values) for key, values in columns.items()}


def rows_of_h5(name):
    with h5py.File(path(name)) as file:
        times = numpy.array([round(t * 1e9) for t in file["time_s"][:]])
        groups = [j for j in file if isinstance(file[j], h5py.Group)]
        return times, {(j, c): file[j][c][:] for j in groups for c in file[j] if not c.startswith("cycle_")}


def compare_part(name, times, columns, telemetry, least=10):
    """Rows without a gap, whose every double is that of telemetry.h5 of the same time."""
    all_times, all_columns = rows_of_h5(telemetry)
    check(f"{name}: has {least} rows or more", len(times) >= least, len(times))
    begin = int(numpy.searchsorted(all_times, times[0]))
    check(f"{name}: rows without a gap", (times == all_times[begin : begin + len(times)]).all(), (times[:3], begin))
    check(f"{name}: all channels", columns.keys() == all_columns.keys(), set(columns) ^ set(all_columns))
    differing = [
        key
        for key, values in columns.items()
        if values.tobytes() != all_columns[key][begin : begin + len(values)].tobytes() or len(values) != len(times)
    ]
    check(f"{name}: every double is that of telemetry.h5", not differing, differing)
