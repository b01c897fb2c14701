"""First sentences that once misled: of a run whose motors do no work, of runs whose friction differs in power alone.
Arguments: tribotwin, tribotwin-report."""
import json, re, shutil, sys

from browser import opening
from harness import check, content, finish, path, run
from pendulum import PENDULUM

twin, report = sys.argv[1:3]


def write(name, text):
    with open(path(name), "w") as f:
        f.write(text)


write("pendulum.xml", PENDULUM)
write("off.yaml", "model: pendulum.xml\nduration_s: 0.2\ncontrol: {type: torque}\n")
write(
    "on.yaml",
    "model: pendulum.xml\nduration_s: 0.5\n"
    "motion: {type: cycle, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}], speed_rad_s: 2}\n",
)
run(twin, "run", "off.yaml", "-o", "off", "--quiet")
summary = json.loads(content("off/summary.json"))
check("the motors do no work", summary["motor_work_J"] == 0, summary)
run(report, "off", "-o", "off.html", "--quiet")
page = content("off.html")
read = re.sub(r"<(svg|style|script).*?</\1>", "", page, flags=re.S)
check("no share of nothing", not re.search(r"\b(inf|nan)\b", read))
check("a run without heat has no warm-up to predict", not re.search("What if:|Not predicted", read))
check("it is said", "without work of the motors" in opening(page)["verdict"], opening(page))

# Friction that is a twentieth less power and as large in root mean square.
run(twin, "run", "on.yaml", "-o", "on", "--quiet")
shutil.copytree(path("on"), path("less"))
summary = json.loads(content("less/summary.json"))
summary["friction_work_J"] *= 0.95
write("less/summary.json", json.dumps(summary))
run(report, "on", "less", "-o", "both.html", "--quiet")
said = opening(content("both.html"))["verdict"]
check(
    "a change of friction work is in the first sentence",
    said.endswith(", but friction work falls by 5.0 % in less."),
    said,
)
finish()
