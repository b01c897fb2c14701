"""The claim on real recordings of an XL-330 (tests/README.md): what each fit of the shipped xl330_fit.yaml predicts of
the recordings that it has not seen. xl330_parameters.json holds the numbers that these fits found, each with seed 1 and
at most 400 evaluations; here they are evaluated only. Arguments: program, source tree."""
import json, os, re, sys

import harness
from harness import check, finish, path

program, source = sys.argv[1], sys.argv[2]
real = os.path.join(source, "..", "shared", "data", "bam_xl330", "raw")
if not os.path.isdir(real):
    print(
        "SKIPPED: the recordings of ../shared/data are not beside this checkout; "
        "the claim of 29.3 mrad on real recordings was NOT tested"
    )
    sys.exit(0)

with open(os.path.join(os.path.dirname(__file__), "xl330_parameters.json")) as f:
    stored = json.load(f)
with open(os.path.join(source, "twin", "scenarios", "xl330_fit.yaml")) as f:
    text = f.read().replace("../../mjcf", os.path.join(source, "mjcf"))
head, variants = text[: text.index("variants:")], text[text.index("variants:") :].split("  - label: ")[1:]
head = "\n".join(x for x in head.split("\n") if not x.startswith(("recordings:", "hold_out:", "reference:")))
head = re.sub(r"#[^\n]*", "", head)


def known(section, numbers):
    """The section with the stored number in place of each free one."""
    return re.sub(r"(\w+): \{start:[^}]*\}", lambda free: "%s: %.12g" % (free[1], numbers[free[1]]), section)


recordings = {}
for name in sorted(os.listdir(real)):
    with open(os.path.join(real, name)) as f:
        recordings[name] = json.load(f)
mean = {}
for label, splits in stored.items():
    own = re.sub(r"#[^\n]*", "", next(v for v in variants if v.startswith(label + "\n")))
    for split, folds in splits.items():
        key = {"gain": "kp", "trajectory": "trajectory"}[split]
        errors = []
        for fold, numbers in folds.items():
            held_out = [n for n, r in recordings.items() if str(r[key]) == fold]
            name = "%s_%s_%s" % (label, split, fold)
            with open(path(name + ".yaml"), "w") as f:
                f.write("recordings: {files: %s}\n" % json.dumps([os.path.join(real, n) for n in held_out]))
                f.write(known(head, numbers) + "\nvariants:\n  - label: " + known(own, numbers))
            r = harness.run(program, "calibrate", name + ".yaml", "-o", name, "--json", "--quiet", timeout=100)
            if not check(name + " is evaluated", r.returncode == 0, r.stderr):
                continue
            found = json.loads(r.stdout)["variants"][0]
            check(name + ": nothing is free, four recordings", found["sought"] == 0 and len(held_out) == 4, found)
            errors.append(found["all"]["learning_mae_mrad"])
            claimed = numbers["held_out_mae_mrad"]
            check(name + ": the error of the claim", abs(errors[-1] / claimed - 1) < 0.01, (errors[-1], claimed))
        mean.setdefault(label, []).append(sum(errors) / max(1, len(errors)))
print(mean)
both = {label: sum(splits) / 2 for label, splits in mean.items()}
check("29.3 mrad held out, both splits, and at most 30", abs(both["load_warm"] - 29.3) < 0.3, both)
check("Coulomb and viscous friction has 57.8 mrad", abs(both["coulomb_viscous"] - 57.8) < 0.6, both)
finish()
