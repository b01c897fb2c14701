"""Ten viewers of a real `tribotwin run --web` at once, one of them a page in chromium: each has every row since it
came. Arguments: tribotwin, source tree."""
import os, signal, subprocess, sys, threading

import numpy

from harness import check, content, finish, path, work
from web_viewer import PATIENCE_S, compare, watch, web_address
import devtools, shown

tribotwin, source = sys.argv[1:]
OTHERS = 9
ROWS = "Number(document.querySelector('#rows data').value)"


class Viewer(threading.Thread):
    def __init__(self, where):
        super().__init__(daemon=True)
        self.where, self.heard = where, None
        self.start()

    def run(self):
        self.heard = watch(*self.where)


def main():
    scenario = os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml")
    command = [tribotwin, "run", scenario, "--realtime", "--quiet", "-o", "run", "--web", "127.0.0.1:0"]
    with open(path("run.log"), "w") as log:
        process = subprocess.Popen([*command, "--set", "duration_s=3600", "--set", "telemetry_rate_hz=500"], cwd=work,
                                   stderr=log)  # fmt: skip
    browser = devtools.Browser(work)
    try:
        where = web_address(path("run.log"))
        tab = browser.tab()
        tab.window(1440, 900)
        tab.go("http://{}:{}/".format(*where))
        check("the page is connected", tab.until("document.body.dataset.link === 'up'", PATIENCE_S))
        viewers = [Viewer(where) for _ in range(OTHERS)]
        before = tab.value(ROWS)
        check("rows come to ten", tab.until(f"{ROWS} > {before} + 2000", PATIENCE_S))
        refused = tab.value("fetch('/', {cache: 'no-store'}).then(a => a.status)")
        check("an eleventh is still served", refused == 200, refused)
        process.send_signal(signal.SIGTERM)
        check("the run ends in order", process.wait(PATIENCE_S) == 1, content("run.log"))
        check("the page hears of it", tab.until("document.body.dataset.link === 'down'", PATIENCE_S))
        look = tab.value(shown.LOOK)
    finally:
        process.kill()
        browser.close()
    record = shown.Record("run")
    wrong, _ = shown.differing(record, look)
    check(
        "the page shows the last row", look["row"] == record.rows - 1 and not wrong, (look["row"], record.rows, wrong)
    )
    check("it has lost none", look["counted"][1] == 0 and look["counted"][0] > 2000, look["counted"])
    for number, viewer in enumerate(viewers):
        viewer.join(PATIENCE_S)
        texts, numbers, rows, end = viewer.heard
        check(f"viewer {number}: good bye", end == 1001, end)
        whole = (numpy.diff(numbers) == 1).all() and numbers[-1] == record.rows - 1
        check(f"viewer {number}: no row is missing", whole, (numbers[:1], numbers[-1:], record.rows))
        if number == 0:
            compare("viewer 0", "run", texts["hello"][0], numbers, rows)
    finish()


main()
