"""The power study of a fault study, killed (-9) again and again: the same command goes on, no fault that was finished
is studied again, and the results are those of an undisturbed run. Arguments: program, source tree."""
import os, random, signal, subprocess, sys, time

import harness
from harness import check, check_refused, content, finish, path, work

program, source = sys.argv[1], sys.argv[2]
STUDY = f"""model: {source}/mjcf/br609.xml
procedure: test_cycle
level_noise_nm: 0.05
joints: {{joint3: {{}}, joint5: {{}}}}
diagnosis: {{learn: [healthy], check: [], draws: 20}}
series:
  - name: healthy
    load: {{by: payload, mass_kg: 0}}
    temperature: {{prescribed_degC: {{from: 25, to: 55, count: 8}}}}
"""


def lab(folder, *more):
    return harness.run(program, "lab", "study.yaml", "-o", folder, "--threads", "2", *more)


def powers(folder):
    """The faults that are finished, joint by joint, and when each file was made."""
    found = {}
    for joint in ("joint3", "joint5"):
        at = os.path.join(folder, joint, "power")
        if os.path.exists(path(at, "checksums")):
            for line in content(at + "/checksums").splitlines():
                if line.count(" ") == 1:
                    name = line.split(" ")[1]
                    found[joint, name] = os.stat(path(at, "faults", name)).st_mtime_ns
    return found


def files(folder):
    """All but the hidden leftovers of a killed process."""
    return {
        os.path.relpath(os.path.join(at, name), path(folder)): content(os.path.join(at, name))
        for at, _, names in os.walk(path(folder))
        for name in names
        if not name.startswith(".")
    }


with open(path("study.yaml"), "w") as f:
    f.write(STUDY)
r = lab("whole")
check("undisturbed", r.returncode == 0, r.stderr)
truth, all_of_them = files("whole"), powers("whole")
check("a part per fault and joint", len(all_of_them) == 14, all_of_them.keys())

instants, made, kills = random.Random(1), {}, 0
while kills < 6:
    command = [program, "lab", "study.yaml", "-o", "killed", "--threads", "2", "--quiet"]
    p = subprocess.Popen(command, cwd=work, stdout=-3, stderr=-3, start_new_session=True)
    aim = len(made) + instants.randint(1, 2)
    while p.poll() is None and len(powers("killed")) < aim:
        time.sleep(0.002)
    if p.poll() is not None:
        break
    time.sleep(instants.uniform(0, 0.1))
    os.killpg(p.pid, signal.SIGKILL)
    p.wait()
    kills += 1
    there = powers("killed")
    again = [name for name, when in made.items() if there.get(name) != when]
    check("kill %d: what was finished stays" % kills, not again and len(there) > len(made), (again, len(there)))
    made = there
check("six kills before all are there", kills == 6 and len(made) < 14, (kills, len(made)))
r = lab("killed")
there = powers("killed")
check("the same command goes on", r.returncode == 0, r.stderr)
again = [name for name, when in made.items() if there.get(name) != when]
check("what was finished is not made again", not again, again)
now = files("killed")
check("after six kills the same bytes", now == truth, [n for n in {**now, **truth} if now.get(n) != truth.get(n)])
r = lab("killed")
check("a finished study is not repeated", r.returncode == 0 and powers("killed") == there, r.stderr)

r = lab("killed", "--set", "diagnosis.draws=21")
check_refused("another number of draws", r, ["joint3", "power: holds another campaign", "remove this one"])
check("and the results stay", files("killed") == truth)
r = lab("killed", "--set", "diagnosis.draws=21", "--force")
check("--force makes them anew", r.returncode == 0 and files("killed") != truth, r.stderr)

finish()
