"""The robot in 3-D on the page of a run: what it carries, against the record; what is drawn, in pixels."""
import base64, json, re, zlib

import h5py
import numpy as np

FIGURE = "document.querySelector('figure.robot')"
CANVAS = "document.querySelector('figure.robot canvas')"
RANGE = "document.querySelector('figure.robot input')"
SHOWN = FIGURE + ".getClientRects().length"
# viridis at eighths of its range.
MAP = "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725"
MAP = np.array([[int(colour[i : i + 2], 16) for i in (0, 2, 4)] for colour in MAP.split()])


def unpacked(page, name):
    return zlib.decompress(base64.b64decode(re.search(rf'data-{name}="([^"]*)"', page).group(1)))


def seen_from(a, b):
    """The rotation b in the frame of a; quaternions w x y z."""
    return np.array([a @ b, *(a[0] * b[1:] - b[0] * a[1:] - np.cross(a[1:], b[1:]))])


def turned(moment, child, parent):
    rotations = np.array(moment["pose"]).reshape(-1, 7)[:, 3:]
    return seen_from(rotations[parent], rotations[child])


def check_poses(check, robot, telemetry, joint):
    """Every moment of a run that repeats its work cycle has the position and the temperature of its time."""
    bodies, moments = robot["geometry"]["bodies"], robot["moments"]
    child = next(i for i, body in enumerate(bodies) if body["joint"] == joint)
    parent, k = bodies[child]["parent"], robot["joints"].index(joint)
    with h5py.File(telemetry) as f:
        time, position, degC = (f[name][:] for name in ("time_s", joint + "/position_rad", joint + "/temperature_degC"))
        cycle_time, cycle_degC = f["cycle_time_s"][:], f[joint + "/cycle_temperature_degC"][:]
    period = np.median(np.diff(cycle_time))
    at = np.array([moment["time_s"] for moment in moments])
    check("moments go from the beginning to the end", at[0] == time[0] and at[-1] == time[-1], (at[0], at[-1]))
    check("each is later than the one before", len(at) > 20 and (np.diff(at) > 0).all(), at)
    first = turned(moments[0], child, parent)
    since = [seen_from(first, turned(moment, child, parent)) for moment in moments]
    angles = np.array([2 * np.arctan2(np.linalg.norm(q[1:]), abs(q[0])) for q in since])
    # Between computed work cycles the motion is that of the first one.
    phase = np.where(at < time[-1], (at - time[0]) % period, at - time[0])
    wanted = abs(np.interp(time[0] + phase, time, position) - position[0])
    check("poses are those of the record at their time", abs(angles - wanted).max() < 2e-3, abs(angles - wanted))
    check("no pose stands still", np.ptp(angles) > 0.5 * np.ptp(position) > 0.1, (np.ptp(angles), np.ptp(position)))
    shown = np.array([moment["degC"][k] for moment in moments])
    off = abs(shown - np.interp(at, cycle_time, cycle_degC))[1:-1]
    check("temperatures are those of the record at their time", off.max() < 0.05, off)
    check("the last is that of the last sample", abs(shown[-1] - degC[-1]) < 1e-4, (shown[-1], degC[-1]))
    return degC[-1]


def of_colour(seen, degC, scale):
    """How many pixels have the map's colour of this temperature, as bright as the light makes a housing."""
    place = 8 * (degC - scale[0]) / (scale[1] - scale[0])
    colour = np.array([np.interp(place, range(9), MAP[:, channel]) for channel in range(3)])
    bright = (seen @ colour) / (colour @ colour)
    return int(((bright > 0.7) & (bright < 1.2) & (abs(seen - bright[..., None] * colour).max(axis=2) < 12)).sum())


def move(tab, to):
    tab.value(f"{RANGE}.value = {to}, {RANGE}.dispatchEvent(new Event('input'))")
    tab.until(f"{CANVAS}.dataset.shown === {RANGE}.value")
    return tab.pixels("figure.robot canvas").astype(float)


def check_drawing(check, tab, robot, joint, degC):
    """In the page that is open, with the robot not in sight yet."""
    check("three.js is not run before the figure is in sight", tab.value("window.THREE === undefined"))
    tab.window(640, 900)  # of fewer pixels
    tab.value(CANVAS + ".scrollIntoView({block: 'center'})")
    last = len(robot["moments"]) - 1
    check("it is drawn when it comes into sight", tab.until(f"{CANVAS}.dataset.shown === '{last}'"))
    end, begin, again = move(tab, last), move(tab, 0), move(tab, last)
    check("the slider says the time of the pose", tab.value(f"{FIGURE}.querySelector('output').textContent")
          == robot["moments"][-1]["time"])  # fmt: skip
    check("the slider moves the robot", (abs(end - begin).max(axis=2) > 40).mean() > 0.005)
    check("and back", (abs(end - again).max(axis=2) > 40).mean() < 1e-4)
    warm = [of_colour(seen, degC, robot["scale"]) for seen in (begin, end)]
    check("the housing has the map's colour of its temperature at the end", warm[1] > 100 > 5 * warm[0], warm)
    spot = np.argwhere([[of_colour(row[None, None], degC, robot["scale"]) for row in line] for line in end[::4, ::4]])
    x, y = 4 * spot[len(spot) // 2][::-1]
    at = tab.value(f"(c => [c.left, c.top, c.width])({CANVAS}.getBoundingClientRect())")
    tab.drag(at[0] + x * at[2] / end.shape[1], at[1] + y * at[2] / end.shape[1], 0, 0)
    name = f"{FIGURE}.querySelector('p[role=status] strong')?.textContent"
    check("a click on the housing names its joint", tab.until(f"{name}?.startsWith('{joint}\u00a0')"), tab.value(name))
    tab.value(CANVAS + ".focus()")
    before = tab.pixels("figure.robot canvas").astype(float)
    tab.key("ArrowLeft")
    tab.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    check("a key turns it", (abs(tab.pixels("figure.robot canvas") - before).max(axis=2) > 40).mean() > 0.005)
    wide = "e => e.clientWidth && e.scrollWidth > e.clientWidth + 1"
    for width in (1440, 360):
        tab.window(width, 900)
        found = tab.value(f"[...{FIGURE}.querySelectorAll('*')].filter({wide}).map(e => e.className)")
        check(f"nothing of it is wider than what it is in, at {width}", found == [], found)
    marks = tab.value(f"[...{FIGURE}.querySelectorAll('.marks span')].map(mark => Number(mark.textContent))")
    check(
        "its colour bar has the ends of the pictures", [marks[0], marks[-1]] == robot["scale"], (marks, robot["scale"])
    )
    check("no console message, one script", not tab.console and tab.value("document.scripts.length") == 1, tab.console)


def check_absent(check, tab, open_page):
    """Without scripts, WebGL, or a way to unpack it the page has no such figure; nor has paper."""
    tab.command("Emulation.setEmulatedMedia", media="print")
    check("not on paper", not tab.value(SHOWN))
    tab.command("Emulation.setEmulatedMedia", media="")
    for missing in ("WebGLRenderingContext", "DecompressionStream"):
        gone = tab.command("Page.addScriptToEvaluateOnNewDocument", source=f"delete globalThis.{missing}")
        open_page()
        check(f"no figure without {missing}", not tab.value(SHOWN) and not tab.console, tab.console)
        tab.command("Page.removeScriptToEvaluateOnNewDocument", identifier=gone["identifier"])
    tab.command("Emulation.setScriptExecutionDisabled", value=True)
    open_page()
    check("no figure without scripts", not tab.value(SHOWN))
    tab.command("Emulation.setScriptExecutionDisabled", value=False)


def check_robot(check, tab, page, telemetry, joint, open_page):
    robot = json.loads(unpacked(page, "robot"))
    degC = check_poses(check, robot, telemetry, joint)
    open_page()
    check_drawing(check, tab, robot, joint, degC)
    fetched = [r for r in tab.requests[1:] if not r.startswith("data:")]
    check("nothing is fetched for it", not fetched, fetched)
    check_absent(check, tab, open_page)


def with_many_triangles(folder):
    """The IRB 6620 with a cloud of triangles around it that has more digits than a page takes."""
    random = np.random.default_rng(1)
    corner = random.normal(size=(8000, 3))
    corner /= np.linalg.norm(corner, axis=1)[:, None]
    side = np.cross(corner, random.normal(size=corner.shape))
    side *= 0.02 / np.linalg.norm(side, axis=1)[:, None]
    vertices = np.stack([corner, corner + side, corner + np.cross(corner, side)], 1).ravel()
    numbers = " ".join(f"{x:.7g}" for x in vertices), " ".join(map(str, range(len(vertices) // 3)))
    with open(folder + "/irb6620.xml") as f:
        model = f.read().replace('file="', f'file="{folder}/')
    mesh = '<asset><mesh name="cloud" vertex="%s" face="%s"/></asset>' % numbers
    cloud = '<geom type="mesh" mesh="cloud" contype="0" conaffinity="0"/></worldbody>'
    return model.replace("</worldbody>", cloud).replace("</mujoco>", mesh + "</mujoco>")
