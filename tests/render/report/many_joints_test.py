"""The page of a robot of thirty joints, in a real browser. Arguments: tribotwin, tribotwin-report."""
import html, json, re, sys

from browser import Browser, opening
from harness import check, content, finish, path, run, work
from numbers_of_page import text_of
from pendulum import several

twin, report = sys.argv[1:3]
browser = Browser(work, check)
joints = ["hinge"] + [f"joint{k}" for k in range(2, 31)]
waypoints = [{"position_rad": {joint: way for joint in joints}} for way in (-0.5, 0.6)]
with open(path("thirty.xml"), "w") as f:
    f.write(several(joints))
with open(path("thirty.yaml"), "w") as f:
    json.dump(
        {
            "model": "thirty.xml",
            "duration_s": 12,
            "motion": {"type": "cycle", "waypoints": waypoints, "speed_rad_s": 2},
        },
        f,
    )
r = run(twin, "run", "thirty.yaml", "-o", "thirty", "--quiet")
check("thirty joints run", r.returncode == 0, r.stderr)
r = run(report, "thirty", "--quiet")
check("their page is made", r.returncode == 0 and r.stderr == "", (r.stdout, r.stderr))
browser.check_page("thirty joints", path("thirty/report.html"), 3, None, widths=(1440, 360))
read = text_of(content("thirty/report.html"))
data = [json.loads(html.unescape(d)) for d in re.findall(r'data-figure="([^"]*)"', content("thirty/report.html"))]
looks = [(s["stroke"], s["dash"]) for d in data if d["title"] == "Temperature" for s in d["series"] if s["label"]]
check("no two joints have the same colour and dashes", len(looks) == len(set(looks)) == 30, looks)
rows = [joint for joint in joints if re.search(rf"^{joint}\n(?:[\d.·⁻⁰¹²³⁴-⁹–]+\n){{8}}", read, re.M)]
check("each joint has its row", rows == joints, set(joints) - set(rows))
pages = browser.printed(path("thirty/report.html"), path("thirty.pdf"))
check("it is printed on at most eight pages", 1 <= pages <= 8, pages)
r = run(report, "thirty", "thirty", "-o", "both.html", "--quiet")
check("two runs of it are compared", r.returncode == 0 and r.stderr == "", (r.stdout, r.stderr))
check(
    "none of them differs",
    opening(content("both.html"))["verdict"].startswith("No joint's friction (RMS) differs by more than 1 %"),
    opening(content("both.html"))["verdict"],
)
finish()
