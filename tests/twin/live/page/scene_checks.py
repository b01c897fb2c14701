"""The robot in 3-D on the page of the live bench, in pixels."""
import json

import numpy

from harness import check
import devtools

CANVAS = "document.querySelector('#scene_canvas')"
# The ends of viridis.
COLD, WARM = (0x44, 0x01, 0x54), (0xFD, 0xE7, 0x25)


def near(seen, colour, off=45):
    """Which pixels have about this colour: housings are lit a little."""
    return numpy.abs(seen - numpy.array(colour)).max(axis=2) <= off


def drawn(tab, row):
    """Waits until this row's pose was drawn, and the colours after it."""
    check(f"the pose of row {row} is drawn", tab.until(f"Number({CANVAS}.dataset.row) === {row}"))


def redrawn(tab, act):
    """Whether the picture is drawn anew by it, and with every view that it asked for."""
    before = int(tab.value(CANVAS + ".dataset.drawings"))
    act()
    return tab.until(f"Number({CANVAS}.dataset.drawings) > {before} && {CANVAS}.dataset.view === "
                     f"{CANVAS}.dataset.asked", 30)  # fmt: skip


def middle(where):
    """(x, y) of these pixels."""
    y, x = numpy.nonzero(where)
    return (float(x.mean()), float(y.mean())) if len(x) else (None, None)


def reds(seen):
    return (seen[:, :, 0] > 90) & (seen[:, :, 1] < 60) & (seen[:, :, 2] < 60)


def check_drawing(tab, bench):
    bench.poses(1399, 0)
    drawn(tab, 1399)
    seen = tab.pixels("#scene_canvas")
    check("the robot's red boxes are seen", reds(seen).mean() > 0.005, reds(seen).mean())  # a slim tower
    check("the legend is that of the joints' temperatures, in degrees",
          tab.value("document.querySelector('#scene_marks').innerText.split(/\\s+/)") == ["20", "40", "60", "80", "100",
          "120"])  # fmt: skip
    check("what was simplified is said", tab.value("document.querySelector('#scene_notes').textContent")
          == "; 1 of 1 meshes are drawn simplified")  # fmt: skip
    labels = tab.value("[...document.querySelectorAll('.scene_label')].filter(l => !l.hidden).map(l => l.innerText)")
    check("the warmest joint and the one in fault have labels",
          labels == ["✖ joint3 55.1 °C", "joint5 113.4 °C warmest"], labels)  # fmt: skip
    x, y = middle(reds(seen))
    bench.poses(1400, 1.0)
    drawn(tab, 1400)
    moved = middle(reds(tab.pixels("#scene_canvas")))
    check("it moves when a pose comes, by what came", moved[0] - x > 20 and abs(moved[1] - y) < 25, (x, y, moved))
    bench.poses(1401, 0)
    drawn(tab, 1401)


def check_colours(tab, bench, row):
    """joint5 is warmest; then joint2 becomes it."""
    below = lambda s, colour: middle(near(s, colour, 30))[1]
    seen = tab.pixels("#scene_canvas")
    height = seen.shape[0]
    warm = below(seen, (0xD8, 0xE2, 0x19))
    check("the housing of joint5, high up, is the light one", warm is not None and warm < height / 2, warm)
    values = row(1401)
    values[1 + 6 * 1 + 5], values[1 + 6 * 4 + 5] = 119.5, 25.0
    bench.rows(1501, [values])
    tab.until("document.querySelector('#warmest_text').innerText.startsWith('joint2')")
    redrawn(tab, lambda: bench.poses(1501, 0))
    warm = below(tab.pixels("#scene_canvas"), WARM)
    check("then that of joint2, low", warm is not None and warm > height / 2, warm)


def check_hands(tab):
    before = tab.pixels("#scene_canvas")
    tab.value(CANVAS + ".focus()")
    for key, code, name in (("ArrowLeft", 37, "turns"), ("ArrowUp", 38, "tilts"), ("+", 0, "zooms")):
        redrawn(tab, lambda: [tab.key(key, code) for _ in range(3)])
        after = tab.pixels("#scene_canvas")
        change = (numpy.abs(after - before).max(axis=2) > 20).mean()
        check(f"{key} {name} the view", change > 0.01, change)
        before = after
    box = tab.value(f"(r => [r.x + r.width / 2, r.y + r.height / 2])({CANVAS}.getBoundingClientRect())")
    for name, act in (
        ("dragging", lambda: tab.drag(*box, 80, 20)),
        ("dragging with the right button", lambda: tab.drag(*box, 60, 0, "right")),
        ("the wheel", lambda: tab.mouse("mouseWheel", *box, deltaX=0, deltaY=240)),
        ("Home", lambda: tab.key("Home", 36)),
    ):
        check(f"{name} changes the view", redrawn(tab, act))
    held = "document.querySelector('#view').textContent"
    check("none of it is the histories'", tab.value(held) == "following the newest row", tab.value(held))


def check_choice(tab):
    chosen = (
        "[document.querySelector('#watched').value, ...[...document.querySelectorAll('.tile.selected')].map(t => t.id)]"
    )
    tab.pixels("#scene_canvas")
    box = tab.value(f"(r => [r.x, r.y, r.width, r.height])({CANVAS}.getBoundingClientRect())")
    seen = tab.pixels("#scene_canvas")
    y, x = (float(v) for v in numpy.argwhere(near(seen, WARM, 30)).mean(axis=0))
    for kind in ("mousePressed", "mouseReleased"):
        tab.mouse(kind, box[0] + x, box[1] + y, button="left", clickCount=1)
    check("a click on a housing chooses its joint", tab.value(chosen) == ["joint2", "drive_joint2"], tab.value(chosen))
    tab.key("n")
    check("n chooses the next one", tab.value(chosen) == ["joint3", "drive_joint3"], tab.value(chosen))
    redrawn(tab, lambda: tab.value("document.querySelector('#drive_joint4 .name').click()"))
    label = tab.value("document.querySelector('.scene_label.selected').innerText")
    check("a tile chooses its joint in the picture", label.startswith("joint4 "), label)


def check_hidden(tab, bench):
    """Scrolled away or in a hidden tab nothing is drawn."""
    tab.value("document.querySelector('#keys').scrollIntoView()")
    tab.until("document.querySelector('#robot').getBoundingClientRect().bottom < 0")
    tab.value("new Promise(done => setTimeout(done, 300))")
    before = tab.value(CANVAS + ".dataset.drawings")
    for row in range(1510, 1520):
        bench.poses(row, row / 1000)
        tab.value("new Promise(done => setTimeout(done, 50))")
    after = tab.value(CANVAS + ".dataset.drawings")
    check("nothing is drawn that cannot be seen", before == after, (before, after))
    tab.value("scrollTo(0, 0)")
    drawn(tab, 1519)


def check_freed(tab, before):
    now = int(tab.value(CANVAS + ".dataset.geometries"))
    check("another start of the program frees the shapes of the old robot", 0 < now <= before, (now, before))


def check_without_webgl(folder, address, work):
    browser = devtools.Browser(work + "/without", "--disable-3d-apis")
    try:
        tab = browser.tab()
        tab.window(1440, 900)
        tab.go(address)
        said = tab.until("document.querySelector('#scene_problem').textContent")
        check("without WebGL the page says so", said.startswith("This browser has no WebGL"), said)
        check("and shows all else", tab.until("document.querySelectorAll('.tile').length === 6"))
        check("three.js is not loaded", not any("three" in r for r in tab.requests), tab.requests)
        lines = [line for line in tab.console if "WebGL" not in line]
        check("without an error of its own", lines == [], json.dumps(tab.console))
    finally:
        browser.close()
