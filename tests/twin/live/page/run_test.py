"""The page of a real `tribotwin run --web` in chromium: its numbers are those of telemetry.h5, its buttons do what
scenario.yaml then says, and it outlives the program. Arguments: tribotwin, source tree."""
import os, re, signal, subprocess, sys

import yaml

from harness import check, content, finish, path, work
from recorded_rows import compare_part, rows_of_h5, rows_of_mcap
from web_viewer import PATIENCE_S, web_address
import devtools, shown

tribotwin, source = sys.argv[1:]
RATE = 500
JOINTS = [f"joint{n}" for n in range(1, 7)]
ROW = "Number(document.querySelector('#drives').dataset.row)"
SIMULATED = "Number(document.querySelector('#simulated data').value)"
PRESSED = (
    ("ambient", {}, {"temperature_degC": "61.123456789012345"}),
    ("payload", {}, {"mass_kg": "40"}),
    ("wear", {"joint": "joint2", "parameter": "Fc0"}, {"factor": "3"}),
    ("joint_fault", {"joint": "joint3", "fault": "preload_loss"}, {"severity": "0.25", "growth_per_h": "0.5"}),
    ("marker", {}, {"text": "null"}),
    ("marker", {}, {"text": "- a: 'b' # \"c\" \u00b0"}),
)
RECORDED = [
    {"type": "ambient", "temperature_degC": 61.123456789012345},
    {"type": "payload", "mass_kg": 40},
    {"type": "wear", "joint": "joint2", "factors": {"Fc0": 3}},
    {"type": "fault", "joint": "joint3", "fault": "preload_loss", "severity": 0.25, "growth_per_h": 0.5},
    {"type": "marker", "text": "null"},
    {"type": "marker", "text": "- a: 'b' # \"c\" \u00b0"},
]


def start(scenario, folder, port=0):
    """A run that lasts until it is ended, and its port."""
    command = [tribotwin, "run", scenario, "--realtime", "--quiet", "-o", folder, "--web", f"127.0.0.1:{port}"]
    command += ["--set", "duration_s=3600", "--set", f"telemetry_rate_hz={RATE}"]
    with open(path(folder + ".log"), "w") as log:
        process = subprocess.Popen(command, cwd=work, stderr=log)
    try:
        return process, web_address(path(folder + ".log"))[1]
    except RuntimeError:
        process.kill()
        raise


def look(tab, looks):
    looks.append(tab.value(shown.LOOK))


def advance(tab, rows):
    """Until the tiles are that many rows further."""
    row = tab.value(ROW)
    return check(f"the run goes on from row {row}", tab.until(f"{ROW} >= {row + rows}", PATIENCE_S))


def pause(tab, looks):
    """It stands, goes on by as many rows as were asked for, and stands."""
    answer = shown.press(tab, "pause")
    check("pause is obeyed", answer[0] == "done" and "paused at " in answer[1], answer)
    stands = "document.querySelector('#run_state').textContent.startsWith('paused')"
    check("the page says that the run is paused", tab.until(stands, PATIENCE_S))
    newest = f"{SIMULATED} - Number(document.querySelector('#cursor_time data').value)"
    check("its last row is there", tab.until(f"{newest} < {1 / RATE + 1e-9}", PATIENCE_S))
    tab.until(f"{ROW} === Number(document.querySelector('#cursor_time data').dataset.row)")
    look(tab, looks)
    refused = shown.press(tab, "pause")
    check("a second pause is refused", refused[0] == "bad" and "paused already" in refused[1], refused)
    row = tab.value(ROW)
    answer = shown.press(tab, "step", cycles="7")
    check("step is obeyed", answer[0] == "done", answer)
    check("it goes on by seven rows", tab.until(f"{ROW} === {row + 7}", PATIENCE_S), (row, tab.value(ROW)))
    wall_s = tab.value("Number(document.querySelector('#wall data').value)")
    tab.until(f"Number(document.querySelector('#wall data').value) > {wall_s + 0.5}", PATIENCE_S)
    check("and no further", tab.value(ROW) == row + 7, tab.value(ROW))
    look(tab, looks)


def act(tab):
    """All buttons of what happens to the robot; [class, text] of the answers."""
    said = [shown.press(tab, command, choose, **typed) for command, choose, typed in PRESSED]
    check("all buttons are obeyed", [s[0] for s in said] == len(PRESSED) * ["done"], said)
    check("each is in the record", all(s[1].endswith("s, in the record") for s in said), said)
    before = tab.value("document.querySelector('#answers').childElementCount")
    form = "form[data-do=payload] "
    tab.fill(form + "input", "-1")
    tab.click(form + "button")
    invalid = tab.value(f"document.querySelector('{form}input').validity.rangeUnderflow")
    grown = tab.value("document.querySelector('#answers').childElementCount") - before
    check("a load below nothing is not sent", (invalid, grown) == (True, 0), (invalid, grown))
    tab.key("Escape", 27)  # the browser's own words for it


def keep_files(tab):
    """Records for a while, and exports; the names of the files. What they hold is looked at after the end."""
    button = "document.querySelector('form[data-do=record] button').textContent"
    begun = shown.press(tab, "record", {"messages": "ros2"})
    check("a recording begins", begun[0] == "done" and tab.until(f"{button} === 'Stop recording'"), begun)
    said = tab.value("document.querySelector('form[data-do=record] .recorded').textContent")
    advance(tab, 100)
    ended = shown.press(tab, "record")
    check("it ends", ended[0] == "done" and tab.until(f"{button} === 'Start recording'"), ended)
    exported = shown.press(tab, "export", {"format": "h5"}, minutes="0.01")
    check("an export is done", exported[0] == "done", exported)
    names = [re.search(r"live-\S+?\.(mcap|h5)", text)[0] for text in (said, ended[1], exported[1])]
    check("the page names the file while it grows and in the end", names[0] == names[1], names)
    said_rows = int(re.search(r"(\d+) rows, .* min asked for", exported[1])[1])
    return *names[1:], said_rows


def check_files(recorded, exported, said_rows):
    compare_part("recorded", *rows_of_mcap("first/" + recorded), "first/telemetry.h5", 100)
    times, columns = rows_of_h5("first/" + exported)
    compare_part("exported", times, columns, "first/telemetry.h5", 200)
    check("exported: as many rows as the page says", len(times) == said_rows, (len(times), said_rows))
    length_s = 1e-9 * (times[-1] - times[0])
    check("exported: what was asked for", abs(length_s - 0.6) < 0.011, length_s)


def check_record(tab):
    """After the end: what the page did is in scenario.yaml, and what it shows as events."""
    events = yaml.safe_load(content("first/scenario.yaml"))["events"]
    times = {e.pop("time_s") for e in events}
    check("scenario.yaml has all that was pressed", events == RECORDED, events)
    check("it happened while the run stood", len(times) == 1, times)
    listed = tab.value("[...document.querySelectorAll('#event_list li')].filter(l => !l.innerText.includes('note'))"
                       ".reverse().map(l => [l.children[0].title, "
                       "l.children[1].textContent, l.children[2].textContent])")  # fmt: skip
    said = [row[2] for row in listed]
    warm = f"ambient, temperature_degC {RECORDED[0]['temperature_degC']!r}"
    want = [warm, "payload, mass_kg 40", "joint2: wear, Fc0 3",
            "joint3: preload_loss, growth_per_h 0.5, severity 0.25", "null", PRESSED[-1][2]["text"]]  # fmt: skip
    check("the page lists them", said == want, said)
    shown_s = {float(row[0].split(" s")[0]) for row in listed}
    check("with their time", shown_s == times, (shown_s, times))


def check_cursor(tab, record):
    """By keyboard through the histories that are kept, also when the program is gone."""
    tab.value("document.querySelector('#window').value = '0', document.querySelector('#window').onchange()")
    tab.value("document.querySelector('.history').focus()")
    looks = []
    for key, code, modifiers in [("Home", 36, 0), *3 * [("ArrowRight", 39, 0)], *5 * [("ArrowRight", 39, 8)],
                                 ("End", 35, 0), *3 * [("ArrowLeft", 37, 0)]]:  # fmt: skip
        tab.key(key, code, modifiers)
        look(tab, looks)
    wrong = [w for one in looks for w in shown.differing(record, one)[0]]
    check("the cursor shows the row on which it is, to the bit", not wrong, wrong[:5])
    rows = [one["cursor"] for one in looks]
    check("one row further with each key", rows[1:4] == [rows[0] + n for n in (1, 2, 3)], rows)
    check("and back", rows[-4:] == [rows[-4] - n for n in range(4)] and rows[-4] == record.rows - 1, rows)
    tab.key("Escape", 27)


def test_run(tab):
    process, port = start(os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml"), "first")
    try:
        tab.go(f"http://127.0.0.1:{port}/")
        check("the page is connected", tab.until("document.body.dataset.link === 'up'", PATIENCE_S))
        check("rows come", tab.until(f"{ROW} > 100", PATIENCE_S))
        looks = []
        for _ in range(3):
            advance(tab, 20)
            look(tab, looks)
        pause(tab, looks)
        act(tab)
        answer = shown.press(tab, "resume")
        check("resume is obeyed", answer[0] == "done", answer)
        for _ in range(5):
            advance(tab, 40)
            look(tab, looks)
        files = keep_files(tab)
        process.send_signal(signal.SIGTERM)
        check("the run ends in order", process.wait(PATIENCE_S) == 1, content("first.log"))
    finally:
        process.kill()
    check("the page says that it is gone", tab.until("document.body.dataset.link === 'down'", PATIENCE_S))
    look(tab, looks)
    record = shown.Record("first")
    shown.check_looks("run", record, looks, 6 * (6 + 4) + 2)
    check("no row is lost", looks[-1]["counted"][1] == 0, looks[-1]["counted"])
    check("the last row is shown", looks[-1]["row"] == record.rows - 1, (looks[-1]["row"], record.rows))
    check_files(*files)
    check_record(tab)
    check_cursor(tab, record)
    return port


def test_restart(tab, port):
    """Another robot on the same port, killed, and the first one again: nothing of the old one stays."""
    with open(path("pendulum.yaml"), "w") as file:
        file.write(f"model: {source}/mjcf/xl330_pendulum.xml\ncontrol: {{type: torque}}\n")
    other = path("pendulum.yaml")
    tiles = "[...document.querySelectorAll('.tile')].map(t => t.id).join(' ')"
    process, _ = start(other, "second", port)
    try:
        check("the page finds the next program by itself", tab.until("document.body.dataset.link === 'up'", 60))
        check("it shows the other robot alone", tab.until(f"!{tiles}.includes('joint2')", PATIENCE_S), tab.value(tiles))
        check("rows come", tab.until(f"{ROW} > 5", PATIENCE_S))
        kept = tab.value("[document.querySelectorAll('#event_list li').length, "
                         "document.querySelectorAll('#answers li').length, "
                         "[...document.querySelectorAll('.history')].length]")  # fmt: skip
        check("old events and answers are forgotten", kept[:2] == [0, 0], kept)
        one = tab.value(shown.LOOK)
        check("nothing is lost", one["counted"][1] == 0 and one["counted"][0] >= one["row"] - 4096, one["counted"])
    finally:
        process.kill()  # -9
        process.wait()
    check("the page says that it was killed", tab.until("document.body.dataset.link === 'down'", PATIENCE_S))
    process, _ = start(os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml"), "third", port)
    try:
        check("it comes back", tab.until("document.body.dataset.link === 'up'", PATIENCE_S))
        all_six = " ".join("drive_" + joint for joint in JOINTS)
        check("with the six joints", tab.until(f"{tiles} === {all_six!r}", PATIENCE_S), tab.value(tiles))
        check("rows come", tab.until(f"{ROW} > 50", PATIENCE_S))
        look(tab, looks := [])
        process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)
    finally:
        process.kill()
    wrong, count = shown.differing(shown.Record("third"), looks[0])
    check("with the numbers of that run", not wrong and count > 60, (wrong[:3], count))


def main():
    browser = devtools.Browser(work)
    try:
        tab = browser.tab()
        tab.window(1440, 900)
        port = test_run(tab)
        test_restart(tab, port)
        gone = f"ws://127.0.0.1:{port}/live"
        lines = [line for line in tab.console if gone not in line]
        check("no console message but for the lost connection", not lines, lines)
    finally:
        browser.close()
    finish()


main()
