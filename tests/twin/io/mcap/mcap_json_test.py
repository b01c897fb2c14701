"""`tribotwin export --mcap --messages json`, read by a reader of its own: every checksum, index and number of the file
is checked, and every double is that of telemetry.h5. Arguments: tribotwin, source tree."""
import json, math, sys

import h5py
import numpy

from harness import check, check_refused, finish, path, run
from mcap_file import MAGIC, Mcap

tribotwin, source = sys.argv[1:]


def same_bits(numbers, recorded):
    """null is a number that is not finite."""
    read = numpy.array([math.nan if x is None else x for x in numbers])
    finite = numpy.isfinite(recorded)
    return (numpy.isfinite(read) == finite).all() and (read.view("u8") == recorded.view("u8"))[finite].all()


def compare(name, mcap, folder):
    by_topic = {c[1]: (n, c) for n, c in mcap.channels.items()}
    with h5py.File(path(folder, "telemetry.h5")) as file:
        time_s = file["time_s"][:]
        joints = [j for j in file if isinstance(file[j], h5py.Group)]
        check(f"{name}: a topic for each joint", {f"/joints/{j}" for j in joints} == set(by_topic), list(by_topic))
        for joint in joints:
            number, (schema, _, encoding, _) = by_topic[f"/joints/{joint}"]
            schema_name, kind, text = mcap.schemas[schema]
            check(
                f"{name}: {joint} is JSON", (encoding, kind, schema_name) == ("json", "jsonschema", "tribotwin.Joint")
            )
            messages = [json.loads(text) for _, text in mcap.messages[number]]
            times = [t for t, _ in mcap.messages[number]]
            check(f"{name}: {joint}: times are whole nanoseconds", times == [round(t * 1e9) for t in time_s])
            check(f"{name}: {joint}: time_s", same_bits([m["time_s"] for m in messages], time_s))
            keys = {"time_s"} | {k for k in file[joint] if not k.startswith("cycle_")}
            check(f"{name}: {joint}: keys", all(set(m) == keys for m in messages), (keys, messages[:1]))
            properties = json.loads(text)["properties"]
            check(f"{name}: {joint}: the schema has them too", set(properties) == keys, properties)
            for key in sorted(keys - {"time_s"}):
                data = file[joint][key]
                check(f"{name}: {joint}.{key}: every double", same_bits([m[key] for m in messages], data[:]))
                says = properties[key]["description"]
                check(f"{name}: {joint}.{key}: its unit", says.endswith(f"[{data.attrs['unit'].decode()}]"), says)


def test_all_numbers():
    run(
        tribotwin,
        "run",
        "irb6620_hold",
        "-o",
        "rec",
        "--quiet",
        "--set",
        "duration_s=5",
        "--set",
        "telemetry_rate_hz=200",
    )
    made = run(tribotwin, "export", "rec", "--mcap", "--messages", "json", "-o", "rec.mcap")
    check("it says where", made.stdout == "rec.mcap\n", made)
    mcap = Mcap(path("rec.mcap"))
    check("there are several chunks", len(mcap.chunks) > 1, len(mcap.chunks))
    check("no profile, because it is not of ROS", (mcap.profile, mcap.library) == ("", "tribotwin"), mcap.profile)
    compare("rec", mcap, "rec")
    metadata = next(iter(mcap.metadata.values()))
    check("the run's attributes are metadata", metadata[1] == "tribotwin" and metadata[2]["complete"] == "1", metadata)
    before = open(path("rec.mcap"), "rb").read()
    again = run(tribotwin, "export", "rec", "--mcap", "--messages", "json", "-o", "rec.mcap")
    check_refused("never overwritten without --force", again, "rec.mcap", lines=None)
    check("and it is what it was", open(path("rec.mcap"), "rb").read() == before)
    run(tribotwin, "export", "rec", "--mcap", "--messages", "json", "-o", "rec.mcap", "--force")
    check("the same bytes again", open(path("rec.mcap"), "rb").read() == before)


def test_the_reader_finds_damage():
    """Else the checks above say nothing."""
    whole = open(path("rec.mcap"), "rb").read()
    found = 0
    places = range(len(MAGIC), len(whole) - len(MAGIC), len(whole) // 50)
    for at in places:
        with open(path("damaged.mcap"), "wb") as file:
            file.write(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        try:
            Mcap(path("damaged.mcap"))
        except Exception:
            found += 1
    check("every changed bit is found", found == len(places), (found, len(places)))


def test_options():
    check_refused(
        "--messages alone", run(tribotwin, "export", "rec", "--csv", "--messages", "json"), "--mcap", lines=None
    )
    wrong = run(tribotwin, "export", "rec", "--mcap", "--messages", "yaml")
    check_refused("unknown messages", wrong, "--messages", lines=None)


test_all_numbers()
test_the_reader_finds_damage()
test_options()
finish()
