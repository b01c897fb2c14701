"""tribotwin-report study on a folder that somebody else has written: a study of many curves is read in proportion to
them. Argument: tribotwin-report."""
import json, os, sys, time

import harness
from harness import check, check_refused, finish, path

report = sys.argv[1]
CURVES, OBSERVATIONS = 100_000, 20_000
FEATURES = {"Fc": 5, "Fs": 8, "Vs": 2, "Fv": 3, "beta": 0.6}


def study(last):
    """Of one joint, whose last healthy observation is of curve `last`."""
    os.makedirs(path("study", "joint1"), exist_ok=True)
    with open(path("study", "joint1", "curves.csv"), "w") as f:
        f.write("curve,series,speed_rad_s,friction_nm\n")
        f.writelines(f"{k},1,1,5\n" for k in range(1, CURVES + 1))
    learned = [{"curve": k, "temperature_degC": 30, "features": FEATURES} for k in [CURVES] * OBSERVATIONS + [last]]
    with open(path("study", "diagnosis.json"), "w") as f:
        json.dump({"joint1": {"learned": learned, "observations": []}}, f)


for last in (CURVES + 1, 1.5, -1e12, 0):
    study(last)
    began = time.process_time() + sum(os.times()[2:4])
    r = harness.run(report, "study", "study")
    took = time.process_time() + sum(os.times()[2:4]) - began
    place = f"study/diagnosis.json: joint1: learned {OBSERVATIONS + 1}: curve: joint1/curves.csv has no curve"
    check_refused(f"curve {last}", r, place, 2, lines=None)
    check(f"curve {last}: {OBSERVATIONS} observations of {CURVES} curves are read at once", took < 5, took)
finish()
