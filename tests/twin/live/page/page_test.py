"""The page of the live bench in chromium, against a bench that says what the test wants. Argument: source tree."""
import base64, json, math, sys

from harness import check, finish, path, work
import devtools, mock_bench, scene_checks, shown

JOINTS = 6
TEMPERATURES = [41.2, 74.6, 55.123456789012345, 38.9, 113.4, 47.7]


def row(number):
    """No value of it is round: what is shown exactly must have come exactly."""
    values = [number * 1e-3]
    for j in range(JOINTS):
        angle = 0.3 * number * 1e-3 + j
        values += [math.sin(angle), math.cos(angle) / 3, 1.1 * math.cos(angle) - j, 100 / 3 + math.cos(angle)]
        values += [math.pi * 100 * math.sin(angle), TEMPERATURES[j] + number / 3e6]
    return values


def status(**changes):
    names = [f"joint{j + 1}" for j in range(JOINTS)]
    drives = [{"joint": name, "bus": 0, "node": j + 1, "nmt": "operational"} for j, name in enumerate(names)]
    for j, drive in enumerate(drives):
        drive.update(state="operation enabled", mode="CSP", error_code=0, error_text=None, brake=False)
        drive.update(target={"position_rad": j / 7, "torque_nm": None}, following_error_rad=j / 3000)
        drive.update(time_to_limit_s=None, reaches_limit=False)
    drives[2].update(state="fault", error_code=0x8611, error_text="following error", brake=True)
    drives[4].update(time_to_limit_s=412.5, reaches_limit=True)
    times = {"median": 1000.25, "p99": 1034.125, "max": 1240.5}
    answers = {"median": 84.5, "p99": 121.75, "max": 240.0, "histogram": [[50, 0], [100, 900], [200, 95], [None, 5]]}
    bus = {"name": "can0", "load": 0.6123456, "bit_rate": 1000000, "frames_in": 700, "frames_out": 1300, "syncs": 100}
    bus.update(lost=0, foreign=2, sync_period_us=times, sync_to_tpdo_us=answers)
    said = {"type": "status", "simulated_s": 12.5, "wall_s": 12.75, "paused": False, "recording": False}
    return {**said, "lost_frames": 0, "drives": drives, "buses": [bus], **changes}


VALUES = """(root) => Object.fromEntries([...document.querySelectorAll(root + ' data')]
  .filter(d => d.value !== '').map(d => [d.dataset.name, Number(d.value)]))"""


def values(tab, root):
    return tab.value(f"({VALUES})({json.dumps(root)})")


def received(tab, rows):
    return check(f"{rows} rows arrive", tab.until(f"Number(document.querySelector('#rows data').value) === {rows}"))


def check_numbers(tab, bench):
    bench.rows(1000, [row(n) for n in range(1000, 1400)])
    bench.say(status())
    received(tab, 400)
    last, names = row(1399), [q[0] for q in mock_bench.QUANTITIES]
    tab.until("document.querySelector('#drive_joint6 [data-name=following_error_rad]').value !== ''")
    for j in range(JOINTS):
        sent = dict(zip(names, last[1 + 6 * j :]))
        sent |= {"target.position_rad": j / 7, "following_error_rad": j / 3000}
        shown = values(tab, f"#drive_joint{j + 1}")
        check(f"joint{j + 1}: numbers are those sent, to the last digit", shown == sent, (shown, sent))
    tips = tab.value("[...document.querySelectorAll('#drives data')].map(d => [d.title, d.textContent])")
    units = ("rad", "rad/s", "Nm", "°C")
    shown = [t for t in tips if t[1] != "–"]
    good = all(title.endswith(tuple(f" {u}" for u in units)) and text.endswith(units) for title, text in shown)
    check("every number has its unit, on the tile and in its tooltip", len(shown) >= 48 and good, shown)
    check("the tooltip has all digits", tips[1][0] == f"{row(1399)[1]!r} rad", tips[:3])
    bus = values(tab, "#bus_can0")
    check("bus: load, SYNC and frames as sent", bus["load_percent"] == 100 * 0.6123456 and bus["lost"] == 0, bus)
    check("bus: SYNC to TPDO", bus["sync_to_tpdo_us.p99"] == 121.75 and bus["sync_period_us.max"] == 1240.5, bus)
    bins = tab.value("[...document.querySelectorAll('#bus_can0 .bin title')].map(t => t.textContent)")
    check("bus: histogram", bins == ["below 50 µs: 0", "from 50 below 100 µs: 900", "from 100 below 200 µs: 95",
                                     "from 200 µs: 5"], bins)  # fmt: skip


def check_first_sight(tab):
    wrong = tab.value("document.querySelector('#wrong_list').innerText")
    check("what is wrong stands on top, in words", wrong == "joint3 error 8611h: following error", wrong)
    warmest = tab.value("document.querySelector('#warmest_text').innerText")
    want = "joint5 113.4 °C warm: 6.6 K below 120.0 °C, reached in 6 min"
    check("so does the warmest joint", warmest.startswith(want), warmest)
    marked = tab.value("['wrong', 'warmest'].map(k => [...document.querySelectorAll('.tile.' + k)].map(t => t.id))")
    check("one tile is wrong, one is warmest", marked == [["drive_joint3"], ["drive_joint5"]], marked)
    tile = tab.value("document.querySelector('#drive_joint3').innerText")
    check("its tile says state, NMT, mode and node", all(
        s in tile for s in ("fault", "NMT operational · CSP · node\u00a03", "brake\nset")), tile)  # fmt: skip
    red = """[...document.querySelectorAll('.tile *')].filter(e => e.offsetParent && getComputedStyle(e).color ===
      getComputedStyle(document.querySelector('.tile .fault:not([hidden])')).color).map(e => e.closest('.tile').id)"""
    check("red is on that tile alone", set(tab.value(red)) == {"drive_joint3"}, tab.value(red))


def check_residual(tab, bench):
    """Of a shadow: its limit is a number, that it was exceeded is what is wrong."""
    residual = [
        {"joint": f"joint{j + 1}", "residual_nm": j / 7, "limit_nm": 0.375 if j else None, "exceeded": j == 1}
        for j in range(JOINTS)
    ]
    bench.say(status(residual=residual, drives=None))
    wrong = "document.querySelector('#wrong_list').innerText"
    tab.until(wrong + ".includes('residual')")
    said = tab.value(wrong)
    check(
        "an exceeded residual is what is wrong", said == "joint2 the residual has exceeded its limit of 0.3750 Nm", said
    )
    limits = [values(tab, f"#drive_joint{j + 1}").get("residual.limit_nm") for j in range(JOINTS)]
    check("its limit is on the tile", limits == [None] + 5 * [0.375], limits)
    state = tab.value("document.querySelector('#drive_joint1 .state').innerText")
    check("a joint of a shadow is listened to", state == "listened to on a bus", state)
    bench.say(status())
    tab.until(wrong + ".includes('8611h')")


def check_lost_rows(tab, bench):
    bench.rows(1410, [row(n) for n in range(1410, 1500)])
    received(tab, 490)
    check("ten lost rows are counted", values(tab, "#lost") == {"rows_lost": 10}, values(tab, "#lost"))
    tab.until("document.querySelector('#lost').className === 'bad'")
    check("and stand out", tab.value("document.querySelector('#lost').className") == "bad")


def check_plots(tab):
    tab.value("document.querySelector('.history').scrollIntoView({block: 'center'})")  # what is not seen is not drawn
    box = tab.until("(() => { const r = document.querySelector('.area[data-row] canvas')?.getBoundingClientRect();"
                    "return r && {x: r.x, y: r.y, w: r.width, h: r.height}; })()")  # fmt: skip
    tab.value("document.querySelector('.history').focus()")
    tab.key("End", 35)
    tab.key("ArrowLeft", 37)
    tab.key("ArrowLeft", 37)
    shown = values(tab, "#figures")
    sent = row(1497)
    same = all(
        shown[f"joint{j + 1}.{name}"] == sent[1 + 6 * j + at]
        for j in range(JOINTS)
        for at, name in enumerate(q[0] for q in mock_bench.QUANTITIES)
        if name not in ("velocity_rad_s", "load_nm")
    )
    check("the cursor, two rows back by keyboard, shows that row", same, (shown, sent))
    check("it says when", values(tab, "#cursor_time") == {"cursor_s": sent[0]}, values(tab, "#cursor_time"))
    check("a cursor holds the histories", tab.value("document.querySelector('#hold').textContent") == "Go on")
    tab.key("Escape", 27)
    check("Escape goes on", tab.value("document.querySelector('#view').textContent") == "following the newest row")
    top = "document.querySelector('.area').getBoundingClientRect()"
    y, x, width = tab.value(f"{top}.y") + 60, tab.value(f"{top}.x"), box["w"]
    tab.mouse("mousePressed", x + 0.5 * width, y, button="left", clickCount=1)
    tab.mouse("mouseMoved", x + 0.7 * width, y, button="left", buttons=1)
    tab.mouse("mouseReleased", x + 0.7 * width, y, button="left", clickCount=1)
    view = tab.value("document.querySelector('#view').textContent")
    check("dragging zooms all histories", view.startswith("held: 1."), view)
    tab.value("document.querySelector('#now').click()")


def check_law(tab, bench):
    check("the page watches the first joint", bench.messages == [{"type": "watch", "joint": "joint1"}], bench.messages)
    speeds = [2.0 * i for i in range(40)]
    bench.say({"type": "law", "joint": "joint2", "temperature_degC": 99.0, "load_norm": 0.5, "speed_rad_s": speeds,
               "friction_nm": speeds})  # fmt: skip
    bench.say({"type": "law", "joint": "joint1", "temperature_degC": 41.25, "load_norm": 0.125, "speed_rad_s": speeds,
               "friction_nm": [40 + s for s in speeds]})  # fmt: skip
    bench.rows(1500, [row(1500)])
    text = "document.querySelector('#friction_text').textContent"
    tab.until(text + ".includes('41.3')")
    said = tab.value(text)
    check("the law of the chosen joint, with its temperature", "law load at 41.3 °C and load 0.125 " in said, said)
    check("with points", "Squares: the last 12" in said, said)
    drawn = tab.value(
        "(() => { const c = document.querySelector('#friction_canvas'); return [...c.getContext('2d')"
        ".getImageData(0, 0, c.width, c.height).data].filter((v, i) => i % 4 === 3 && v > 200).length; })()"
    )
    check("something is drawn", drawn > 500, drawn)
    said = {"type": "law", "joint": "joint1", "temperature_degC": 42.0, "load_norm": 0.125}
    bench.say({**said, "speed_rad_s": [v - 40 for v in range(81)], "friction_nm": [70 + v for v in range(81)]})
    tab.until(text + ".includes('42.0')")
    law = lambda: scene_checks.near(tab.pixels("#friction_canvas"), (0x0B, 0x5E, 0xA8), 20)
    seen = law()
    check("backwards it is drawn over the amount of speed", seen[:, 70:].sum() > 300, seen.sum())
    check("none of it beside the axes", not seen[:, :60].any(), seen[:, :60].sum())


def check_print(tab):
    """Also what is out of sight is drawn for paper, and after it the page is as before."""
    rows = "[...document.querySelectorAll('.area')].map(a => a.dataset.row)"
    tab.value("document.querySelector('#keys').scrollIntoView()")
    newest = tab.value("document.querySelector('#drives').dataset.row")
    paper = tab.command("Page.printToPDF")["data"]
    check("on paper all histories are there", tab.value(rows) == 4 * [newest], (tab.value(rows), newest))
    check("it is a PDF", base64.b64decode(paper)[:5] == b"%PDF-")
    kept = tab.value("[document.documentElement.className, document.querySelector('.area').style.width]")
    check("then the page is as before", kept == ["", ""], kept)
    tab.value("scrollTo(0, 0)")


def submit(tab, name, **values_of):
    """By the elements of the form, as somebody would who fills it in."""
    for key, value in values_of.items():
        tab.value(
            f"""(() => {{ const i = document.querySelector('form[data-do={name}]').elements['{key}'];
          i.value = {json.dumps(value)}; i.dispatchEvent(new Event('change', {{bubbles: true}})); }})()"""
        )
    tab.value(f"document.querySelector('form[data-do={name}] button').click()")


def check_commands(tab, bench):
    bench.messages.clear()
    bench.refuse = {"wear"}
    forms = tab.value("[...document.querySelectorAll('#controls form')].map(f => f.dataset.do)")
    check("one form for each command", forms == mock_bench.COMMANDS, forms)
    submit(tab, "pause")
    submit(tab, "step", cycles="25")
    submit(tab, "marker", text="new <b>grease</b>")
    submit(tab, "fault", kind="over_temperature", joint="joint5", duration_s="0.5", temperature_degC="140")
    submit(tab, "fault", kind="drop", joint="", duration_s="2", probability="0.25")
    submit(tab, "fault", kind="bus_off", duration_s="3")
    submit(tab, "wear", joint="joint2", parameter="Fs", factor="1.5")
    submit(tab, "ambient", temperature_degC="-12.5")
    submit(tab, "payload", mass_kg="7.25")
    submit(tab, "joint_fault", joint="joint4", fault="backlash", severity="0.002", growth_per_h="0")
    want = [
        {"do": "pause"},
        {"do": "step", "cycles": 25},
        {"do": "marker", "text": "new <b>grease</b>"},
        {"do": "fault", "kind": "over_temperature", "joint": "joint5", "duration_s": 0.5, "temperature_degC": 140},
        {"do": "fault", "kind": "drop", "duration_s": 2, "probability": 0.25},
        {"do": "fault", "kind": "bus_off", "duration_s": 3},
        {"do": "wear", "joint": "joint2", "parameter": "Fs", "factor": 1.5},
        {"do": "ambient", "temperature_degC": -12.5},
        {"do": "payload", "mass_kg": 7.25},
        {"do": "joint_fault", "joint": "joint4", "fault": "backlash", "severity": 0.002, "growth_per_h": 0},
    ]
    want = [{"type": "command", "id": i + 1, **w} for i, w in enumerate(want)]  # fmt: skip
    check("the answers come", tab.until("document.querySelectorAll('#answers .done, #answers .bad').length === 10"))
    check("commands are sent as the interface says", bench.messages == want, bench.messages)
    answers = tab.value("[...document.querySelectorAll('#answers li')].map(l => [l.className, l.textContent])")
    refused = ["bad", "✖ wear, joint joint2, parameter Fs, factor 1.5: refused, <b>not now</b>"]
    check("a refusal is said", answers[3] == refused, answers)
    check("the others are done", [a[0] for a in answers[:3] + answers[4:]] == 9 * ["done"], answers)
    submit(tab, "step", cycles="0")
    submit(tab, "joint_fault", fault="backlash", severity="0.2")
    check("a number out of range is not sent", len(bench.messages) == 10, bench.messages[10:])


def check_files(tab, bench):
    """What is recorded is said while it is, and what an export really holds."""
    bench.messages.clear()
    form = "document.querySelector('form[data-do=record]')"
    check("nothing is recorded at first", tab.value(f"{form}.innerText").endswith("No page records."))
    exported = {"name": "live-0012.5s.h5", "rows": 1200, "lost_rows": 0, "from_s": 0.1, "to_s": 1.3, "minutes": 0.375}
    message = "live-0012.5s.h5: 1200 rows, 0.375 of 2.5 min asked for"
    bench.also = {"export": {"message": message, "file": exported}}
    shown.press(tab, "record", {"messages": "json"})
    file = {"name": "live-0001.5s.mcap", "rows": 12345, "lost_rows": 0, "from_s": 1.5, "to_s": 13.845,
            "minutes": 0.20575}  # fmt: skip
    bench.say(status(file=file, recording=True))
    stop = f"{form}.querySelector('button').textContent === 'Stop recording'"
    check("the button ends what was begun", tab.until(stop))
    said = tab.value(f"{form}.innerText")
    check("the page says into which file", "live-0001.5s.mcap gets all rows" in said, said)
    numbers = values(tab, "form[data-do=record]")
    check("and how much it has", numbers == {"file.rows": 12345, "file.lost_rows": 0, "file.minutes": 0.20575}, numbers)
    red = f"getComputedStyle({form}.querySelector('[data-name=\"file.lost_rows\"]')).color"
    calm = tab.value(red)
    bench.say(status(file={**file, "lost_rows": 7}, recording=True))
    check("lost rows of a file are red", tab.until(f"{red} !== '{calm}'"), (calm, tab.value(red)))
    shown.press(tab, "record")
    bench.say(status())
    check("then it begins anew", tab.until(f"{form}.innerText.endsWith('No page records.')"))
    answer = shown.press(tab, "export", {"format": "h5"}, minutes="2.5")
    want = "\u2714 export, minutes 2.5, format h5: done, live-0012.5s.h5: 1200 rows, 0.375 of 2.5 min asked for"
    check("an export is answered with its file and what it holds", answer == ["done", want], answer)
    shown.press(tab, "export", {"format": "mcap", "messages": "ros2"}, minutes="1")
    asked = [{k: v for k, v in m.items() if k not in ("type", "id")} for m in bench.messages]
    want = [{"do": "record", "on": True, "messages": "json"}, {"do": "record", "on": False},
            {"do": "export", "minutes": 2.5, "format": "h5"},
            {"do": "export", "minutes": 1, "format": "mcap", "messages": "ros2"}]  # fmt: skip
    check("all as the protocol says", asked == want, asked)


def check_losses(tab, bench):
    """Lost events are wrong; foreign frames are nobody's fault."""
    lost = "document.querySelector('#lost_events')"
    hidden = f"{lost}.parentElement.hidden"
    check("no lost event, no word of it", tab.value(hidden) is True)
    bench.say(status(lost_events=3))
    check("lost events are counted", tab.until(f"!{hidden}") and values(tab, "#lost_events") == {"events_lost": 3})
    colours = tab.value(
        f"[{lost}, document.querySelector('#bus_can0 [data-name=foreign]'), document.querySelector('#wrong_list a') "
        "?? document.querySelector('.fault')].map(e => getComputedStyle(e).color)"
    )
    check("they are red, foreign frames are not", colours[0] == colours[2] != colours[1], colours)
    bench.say(status())
    tab.until(hidden)


EDGES = """[...document.querySelectorAll('#bus_can0 .edge')].map(t => (r => [t.textContent, r.left, r.right])(
  t.getBoundingClientRect())).sort((a, b) => a[1] - b[1])"""


def check_histogram(tab, bench):
    """Bins of a real session: labels where they fit, none over another, at any width."""
    limits = [20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320, 384, 448, 512, 640, 768, 896,
              1024, 1280, 1536, 1792, 2048, 2560, 3072, 3584, 4096]  # fmt: skip
    said = status()
    said["buses"][0]["sync_to_tpdo_us"]["histogram"] = [[limit, 3 + limit % 7] for limit in limits]
    for width in (360, 1440):
        tab.window(width, 900)
        bench.say(said)
        tab.until(f"(e => e.length && e.at(-1)[0].startsWith('4096'))({EDGES})")
        edges = tab.until(f"(e => e.length > 4 && e.at(-1)[2] <= innerWidth && e)({EDGES})")
        names = [e[0] for e in edges]
        check(f"{width} px: labels of bins, with their unit", names[-1] == "4096\u00a0\u00b5s" and len(names) > 4 and
              {int(n.split()[0]) for n in names} <= set(limits), names)  # fmt: skip
        over = [(a, b) for a, b in zip(edges, edges[1:]) if a[2] >= b[1]]
        check(f"{width} px: none over another", not over, over)
    bench.say(status())


def check_keyboard(tab, bench):
    """A command by keys alone."""
    bench.messages.clear()
    tab.value("document.activeElement.blur()")
    tab.key("m")
    tab.command("Input.insertText", text="by hand")
    tab.command("Input.dispatchKeyEvent", type="keyDown", key="Enter", windowsVirtualKeyCode=13, text="\r")
    tab.until("document.querySelector('#answers li').textContent.includes('by hand: done')")
    said = [(m["do"], m["text"]) for m in bench.messages]
    check("m and Enter mark by keyboard alone", said == [("marker", "by hand")], said)
    tab.value("document.activeElement.blur()")
    reached = tab.value(
        "[...document.querySelectorAll('a[href], button, select, input, summary, [tabindex]')]"
        ".filter(e => e.offsetParent && e.tabIndex < 0 && !e.matches('.tile, .scene_label, #drives'))"
        ".map(e => e.outerHTML)"
    )
    check("every control is reached by Tab", reached == [], reached)


def check_events(tab, bench):
    bench.say({"type": "event", "time_s": 1.25, "kind": "emcy", "joint": "joint3", "text": "8611h <img src=x>"})
    bench.say({"type": "event", "time_s": 1.375, "kind": "marker", "joint": None, "text": "here"})
    tab.until("document.querySelectorAll('#timeline .sign').length === 2")
    said = tab.value("[...document.querySelectorAll('#event_list li')].map(l => l.innerText.replace(/\\s+/g, ' '))")
    check("events, newest first", said == ["1.375 s ◆ marker here", "1.250 s ▲ EMCY joint3: 8611h <img src=x>"], said)
    check("they are text, not markup", tab.value("document.images.length") == 0)
    check("and marks on a line of time", tab.value("document.querySelectorAll('#timeline .sign').length") == 2)


def refused(line, port):
    """The browser's own word for each attempt to reach a killed bench; the last one's can come late."""
    return f"ws://127.0.0.1:{port}/live" in line and ("failed" in line or "ERR_CONNECTION" in line)


def check_reconnect(tab, bench, folder):
    port = bench.port
    bench.kill()
    lost = "document.querySelector('#wrong_list').innerText"
    check("a lost connection is said where it cannot be missed", tab.until(lost + ".startsWith('connection lost')"),
          tab.value(lost))  # fmt: skip
    shown = values(tab, "#drive_joint2")["temperature_degC"]
    check("the last numbers stay", shown == row(1502)[12], shown)
    submit(tab, "resume")
    answer = tab.value("document.querySelector('#answers li').textContent")
    check(
        "a command without connection is not called sent", answer == "resume: not sent, there is no connection", answer
    )
    again = mock_bench.MockBench(folder, mock_bench.hello(session="second", commands=["marker", "later"]), port)
    check("it comes back by itself", tab.until("document.body.dataset.link === 'up'"))
    again.rows(0, [row(n) for n in range(50)])
    received(tab, 50)
    check("another session begins anew: nothing is lost", values(tab, "#lost") == {"rows_lost": 0})
    check("its commands alone", tab.value("[...document.querySelectorAll('#controls form')].map(f => f.dataset.do)") ==
          ["marker"])  # fmt: skip
    check("the old events are gone", tab.value("document.querySelectorAll('#event_list li').length") == 0)
    tab.until("Number(document.querySelector('#drive_joint2 [data-name=temperature_degC]').value) === "
              + repr(row(49)[12]))  # fmt: skip
    check("new numbers", values(tab, "#drive_joint2")["temperature_degC"] == row(49)[12])
    return again


OVERFLOW = """[document.documentElement.scrollWidth - innerWidth, [...document.querySelectorAll('body *')].filter(e =>
  !e.closest('svg') && e.getBoundingClientRect().right > innerWidth + 1 && !e.closest('.frame')).map(e => e.outerHTML
  .slice(0, 80))]"""


def check_widths(tab):
    for width, height in ((360, 740), (768, 1024), (1440, 900), (3840, 2160)):
        for scheme in ("light", "dark"):
            tab.window(width, height, scheme)
            tab.until("document.querySelector('.area canvas').getBoundingClientRect().right <= innerWidth")
            over = tab.value(OVERFLOW)
            check(f"nothing is wider than {width} px, {scheme}", over[0] <= 0 and not over[1], over)
            tab.picture(path(f"{width}_{scheme}.png"))
    small = (
        "[...document.querySelectorAll('button, select, input')].filter(e => e.offsetParent && !e.labels?.length && "
    )
    small += "!e.textContent.trim() && !e.ariaLabel).map(e => e.outerHTML)"
    check("every control has a name", tab.value(small) == [], tab.value(small))


def check_readonly(tab, folder):
    bench = mock_bench.MockBench(folder, mock_bench.hello(readonly=True, joints=1, program="run"))
    tab.go(f"http://127.0.0.1:{bench.port}/")
    check("read-only: said", tab.until("!document.querySelector('#readonly').hidden"))
    check("read-only: nothing to act with", tab.value("document.querySelector('#acting').hidden"))
    bench.say(status(drives=None, buses=[]))
    bench.rows(0, [row(n)[:7] for n in range(3)])
    received(tab, 3)
    tile = "document.querySelector('#drive_joint1 .state').textContent"
    check("a drive without a bus", tab.until(tile + " === 'simulated, not on a bus'"), tab.value(tile))
    return bench


def check_memory(tab, bench):
    """More rows than the page keeps, 48 MiB; columns that it does not know make them long."""
    bench.hello = mock_bench.hello(joints=1, session="long")
    bench.hello["columns"] += [{"joint": None, "name": f"more{i}", "unit": ""} for i in range(4089)]
    capacity = 48 * 2**20 // (8 * 4096)
    for viewer in list(bench.viewers):
        viewer.send(json.dumps(bench.hello))
    for first in range(0, 2000, 100):
        bench.rows(first, [row(n)[:7] + [0.0] * 4089 for n in range(first, first + 100)])
    received(tab, 2000)
    kept = tab.until("(t => t.includes(' min at') && t)(document.querySelector('#kept').textContent)")
    said = "This page keeps the last 1\u00a0536 rows of 4096 numbers (48 MiB), 0.0 min at the rate of now"
    check("the page says how much it keeps", kept.startswith(said), kept)
    tab.value("document.querySelector('#window').value = '0', document.querySelector('#window').onchange()")
    tab.value("document.querySelector('.history').focus()")
    tab.key("Home", 36)
    oldest = values(tab, "#cursor_time")
    check("and keeps no more", oldest == {"cursor_s": row(2000 - capacity)[0]}, oldest)


def main():
    folder = sys.argv[1] + "/twin/live/page"
    bench = mock_bench.MockBench(folder, mock_bench.hello())
    browser = devtools.Browser(work)
    try:
        tab = browser.tab()
        tab.window(1440, 900)
        tab.go(f"http://127.0.0.1:{bench.port}/")
        check("connected", tab.until("document.body.dataset.link === 'up'"))
        tab.until("document.querySelectorAll('.tile').length === 6")
        check_numbers(tab, bench)
        check_first_sight(tab)
        check_residual(tab, bench)
        scene_checks.check_drawing(tab, bench)
        check_lost_rows(tab, bench)
        check_plots(tab)
        check_law(tab, bench)
        check_commands(tab, bench)
        check_keyboard(tab, bench)
        check_files(tab, bench)
        check_losses(tab, bench)
        check_histogram(tab, bench)
        check_print(tab)
        check_events(tab, bench)
        scene_checks.check_hands(tab)
        scene_checks.check_colours(tab, bench, row)
        scene_checks.check_choice(tab)
        scene_checks.check_hidden(tab, bench)
        bench.rows(1502, [row(1502)])
        check_widths(tab)
        scene_checks.check_without_webgl(folder, f"http://127.0.0.1:{bench.port}/", work)
        shapes = int(tab.value(scene_checks.CANVAS + ".dataset.geometries"))
        check("no console message", not tab.console, tab.console)
        missing = bench.not_found
        bench = check_reconnect(tab, bench, folder)
        bench.poses(50, 0)
        scene_checks.drawn(tab, 50)
        scene_checks.check_freed(tab, shapes)
        own = (f"http://127.0.0.1:{bench.port}/", f"ws://127.0.0.1:{bench.port}/", "data:,")
        check(
            "no request to anywhere else", tab.requests and all(r.startswith(own) for r in tab.requests), tab.requests
        )
        watching = check_readonly(tab, folder)
        check_memory(tab, watching)
        lines = [line for line in tab.console if not refused(line, bench.port)]
        check("no console message until the end", not lines, lines)
        check("no file is asked for that there is not", missing + watching.not_found == [], missing)
    finally:
        browser.close()
    finish()


main()
