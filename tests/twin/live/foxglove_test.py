"""Foxglove's protocol at `tribotwin run --web` and `tribotwin-hil drive --web`: every double is that of telemetry.h5.
Arguments: tribotwin, tribotwin-hil, source tree."""
import json, os, struct, subprocess, sys

import h5py
import numpy

from harness import check, check_refused, finish, path, run, work
from web_viewer import PATIENCE_S, WebSocket, web_address

tribotwin, hil, source = sys.argv[1:]
scenario = os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml")


def foxglove(host, port, subprotocol, origin):
    """A client written after the protocol's definition."""
    return WebSocket(host, port, subprotocol, "/", origin)


def listen(client):
    """The channels by topic, the messages of each with their times, the texts by op, and the times."""
    channels, messages, texts, times = {}, {}, {}, []
    for opcode, content in client.hear():
        if opcode == 1:
            text = json.loads(content)
            texts.setdefault(text["op"], []).append(text)
            if text["op"] == "advertise":
                channels = {c["topic"]: c for c in text["channels"]}
                wanted = [{"id": 100 + c["id"], "channelId": c["id"]} for c in text["channels"]]
                client.say({"op": "subscribe", "subscriptions": wanted})
                client.say({"op": "getParameters", "parameterNames": [], "id": "1"})
        elif opcode == 2 and content[0] == 2:
            times.append(struct.unpack("<Q", content[1:])[0])
        elif opcode == 2:
            subscription, ns = struct.unpack("<IQ", content[1:13])
            messages.setdefault(subscription - 100, []).append((ns, content[13:], times[-1] if times else None))
    return channels, messages, texts, times


def compare(name, folder, channels, messages, times):
    with h5py.File(path(folder, "telemetry.h5")) as file:
        time_s = file["time_s"][:]
        row_of = {round(t * 1e9): i for i, t in enumerate(time_s)}
        joints = [j for j in file if isinstance(file[j], h5py.Group)]
        topics = sorted([f"/joints/{j}" for j in joints] + ["/status", "/events"])
        check(f"{name}: topics", sorted(channels) == topics, list(channels))
        for joint in joints:
            channel = channels[f"/joints/{joint}"]
            of_joint = messages[channel["id"]]
            rows = [row_of[ns] for ns, _, _ in of_joint]
            numbers = [json.loads(text) for _, text, _ in of_joint]
            check(f"{name}: {joint}: most rows came", len(rows) > 0.4 * len(time_s), (len(rows), len(time_s)))
            check(f"{name}: {joint}: none is missing since", rows == list(range(rows[0], len(time_s))), rows[:5])
            check(f"{name}: {joint}: the time goes before", all(ns == t for ns, _, t in of_joint))
            keys = ["time_s", *json.loads(channel["schema"])["properties"]]
            check(f"{name}: {joint}: all channels", set(keys) == {"time_s", *file[joint]}, keys)
            for key in set(keys):
                data = (time_s if key == "time_s" else file[joint][key][:])[rows]
                came = numpy.array([n[key] for n in numbers])
                check(f"{name}: {joint}.{key}: every double", (came.view("u8") == data.view("u8")).all())
    check(f"{name}: times rise", (numpy.diff(times) > 0).all(), times[:5])


def follow(name, subprotocol, *command):
    origin = "http://localhost:8081"
    with open(path(name + ".log"), "w") as log:
        command = [*command, "-o", name, "--web", "127.0.0.1:0", "--web-origin", origin]
        process = subprocess.Popen(command, cwd=work, stderr=log)
        try:
            address = web_address(path(name + ".log"))
            check(f"{name}: another origin", foxglove(*address, subprotocol, "http://evil.example").status == "403")
            check(f"{name}: it gets no page", foxglove(*address, "tribotwin.live.v1", origin).status == "403")
            client = foxglove(*address, subprotocol, origin)
            check(f"{name}: the named origin", client.status == "101", client.status)
            channels, messages, texts, times = listen(client)
            code = process.wait(PATIENCE_S)
        finally:
            process.kill()
    check(f"{name}: ends well", code == 0, open(path(name + ".log")).read())
    info = texts["serverInfo"][0]
    check(f"{name}: serverInfo", info["capabilities"] == ["time"] and info["metadata"]["program"] == name, info)
    refusals = [s["message"] for s in texts.get("status", []) if s["level"] == 2]
    check(
        f"{name}: parameters are refused", len(refusals) == 1 and "getParameters is not offered" in refusals[0], texts
    )
    compare(name, name, channels, messages, times)
    return [json.loads(text) for _, text, _ in messages[channels["/status"]["id"]]]


def test_run():
    statuses = follow(
        "run", "foxglove.websocket.v1", tribotwin, "run", scenario, "--realtime", "--quiet", "--set", "duration_s=3",
    )  # fmt: skip
    check("run: statuses", len(statuses) > 3 and statuses[-1]["recording"] is True, statuses[-1:])


def test_drive():
    statuses = follow(
        "drive", "foxglove.sdk.v1", hil, "drive", scenario, "--can", "memory:fox", "--realtime", "--duration", "3",
    )  # fmt: skip
    check("drive: states of the drives", [d["mode"] for d in statuses[-1]["drives"]] == ["CSP"] * 6, statuses[-1:])


def test_wrong_origins():
    for origin in ("*", "null", "localhost:8081", "http://a/b"):
        refused = run(tribotwin, "run", scenario, "--quiet", "--web", "127.0.0.1:0", "--web-origin", origin)
        check_refused(f"--web-origin {origin}", refused, "--web-origin")
    check_refused("--web-origin alone", run(tribotwin, "run", scenario, "--web-origin", "file://"), "--web", lines=None)


test_wrong_origins()
test_run()
test_drive()
finish()
