"""The folder that `tribotwin-hil ros2` writes: bus.yml against the EDS beside it, the objects that ros2_canopen needs,
scales against the drives' own objects, names, cycles, and which folders it writes into. Arguments: tribotwin-hil,
source tree."""
import math, os, shlex, shutil, sys

import harness
from harness import check, check_refused, content, finish, path
from pendulum import PENDULUM
from ros2_master import CONTROL, MODE, POSITION, SHOWN, STATUS, SUPPORTED, TORQUE, VELOCITY
from ros2_master import mapping, read_bus, read_eds, size
from session import hold_scenario

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)


def ros2(*arguments, robot=scenario):
    return harness.run(hil, "ros2", robot, *arguments, timeout=60)


def made(folder, *arguments, robot=scenario):
    r = ros2("-o", folder, *arguments, robot=robot)
    check(f"ros2 -o {folder} " + " ".join(arguments), r.returncode == 0 and r.stdout == "", (r.returncode, r.stderr))
    return read_bus(path(folder))


# ---- What the driver for CiA 402 reads and writes, by its source; the last column: in these modes only (any of them).
NEEDED = [
    (CONTROL, "H", ()),
    (STATUS, "H", ()),
    (MODE, "b", ()),
    (SHOWN, "b", ()),
    (SUPPORTED, "I", ()),
    (POSITION, "i", ()),
    (VELOCITY, "i", ()),
    (TORQUE, "h", ()),
    ((0x607A, 0), "i", (1, 8)),
    ((0x60FF, 0), "i", (3, 9)),
    ((0x6071, 0), "h", (4, 10)),
    ((0x6042, 0), "h", (2,)),
    ((0x60C1, 1), "i", (7,)),
    ((0x6098, 0), "b", (6,)),
    # Of its sample configurations.
    ((0x60C2, 1), "B", ()),
    ((0x60C2, 2), "b", ()),
    ((0x6081, 0), "I", (1,)),
    ((0x6083, 0), "I", (1, 3)),
]
CYCLIC = [CONTROL, STATUS, MODE, SHOWN, POSITION, VELOCITY, TORQUE, (0x607A, 0), (0x60FF, 0), (0x6071, 0)]
CYCLIC += [(0x60C1, 1), (0x6042, 0)]  # of modes that a drive may have
RESTRICTED = [(0, 0x7F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x6FF), (0x701, 0x7FF)]


def pdo_faults(way, number, pdo, eds):
    at = (0x1400 if way == "rpdo" else 0x1800) + number - 1
    if not pdo["enabled"]:  # an empty mapping: dcfgen goes by it
        return [] if pdo["mapping"] == [] else [f"{way}{number}: off and mapped"]
    faults = [f"{way}{number}: not with every SYNC"] if pdo["transmission"] != 1 else []
    if any(low <= pdo["cob_id"] <= high for low, high in RESTRICTED):
        faults.append(f"{way}{number}: identifier")
    for key in ((at, 1), (at, 2), (at + 0x200, 0), (at + 0x200, len(pdo["mapping"]))):
        if key not in eds or eds[key].access != "rw":
            faults.append("%04X:%d cannot be written" % key)
    objects = mapping(pdo)
    may = ("rw", "rww", "wo") if way == "rpdo" else ("ro", "rw", "rwr", "const")
    faults += ["%04X:%d is not mappable" % k for k in objects if not eds[k].mappable or eds[k].access not in may]
    if not objects or sum(size(eds[k]) for k in objects) > 8:
        faults.append(f"{way}{number}: 1 to 8 bytes")
    return faults


def sdo_faults(o, eds):
    key = o["index"], o["sub_index"]
    if key not in eds:
        return ["%04X:%d is missing" % key]
    bits, signed = 8 * size(eds[key]), eds[key].kind.islower()
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1)) if signed else (0, 2**bits)
    return [] if eds[key].access == "rw" and low <= o["value"] < high else ["%04X:%d = %s" % (*key, o["value"])]


def needed_faults(part, eds):
    """Objects of the driver that are missing, and those that it takes for mapped (by the EDS) or that it moves with
    every turn, without a PDO."""
    modes = eds[SUPPORTED].default
    faults = []
    for key, kind, only in NEEDED:
        wanted = not only or any(modes >> (m - 1) & 1 for m in only)
        if wanted and (key not in eds or eds[key].kind != kind):
            faults.append("%04X:%d" % key)
    mapped = [k for way in ("rpdo", "tpdo") for pdo in part[way].values() for k in mapping(pdo)]
    if len(mapped) != len(set(mapped)):
        faults.append("an object is mapped twice")
    defaults = {
        (v.default >> 16, v.default >> 8 & 0xFF)
        for (i, s), v in eds.items()
        if s and (0x1600 <= i < 0x1800 or 0x1A00 <= i < 0x1C00) and v.default
    }
    faults += ["%04X:%d is not mapped" % k for k in sorted({*defaults, *CYCLIC} - set(mapped)) if k in eds]
    return faults


def near(a, b):
    return math.isclose(a, b, rel_tol=1e-6)


def scale_faults(part, eds):
    """Joint side, from encoder, gear and rated torque; 606Ch counts 0.001 rpm."""
    gear = eds[0x6091, 1].default / eds[0x6091, 2].default
    count_rad = 2 * math.pi * eds[0x608F, 2].default / eds[0x608F, 1].default / gear
    count_rad_s = 2 * math.pi / 60e3 / gear
    count_nm = 1e-6 * eds[0x6076, 0].default * gear
    return [
        f"{key}: {part[key]}, not {value}"
        for key, value in (
            ("scale_pos_from_dev", count_rad),
            ("scale_pos_to_dev", 1 / count_rad),
            ("scale_vel_from_dev", count_rad_s),
            ("scale_vel_to_dev", 1 / count_rad_s),
            ("scale_eff_from_dev", count_nm),
        )
        if not near(part[key], value)
    ]


# ---- The robot of the README.
bus, parts = made("bus")
check(
    "one EDS per drive, bus.yml, README.md, and nothing else",
    sorted(os.listdir(path("bus"))) == sorted(["bus.yml", "README.md", *("node%d.eds" % n for n in range(1, 7))]),
    os.listdir(path("bus")),
)
check("options", bus["options"] == {"dcf_path": "@BUS_CONFIG_PATH@"}, bus["options"])
master = {
    "node_id": 127,
    "driver": "ros2_canopen::MasterDriver",
    "package": "canopen_master_driver",
    "sync_period": 10000,
}
check("master", bus["master"] == master, bus["master"])
check("joints are nodes", {n: p["node_id"] for n, p in parts.items()} == {"joint%d" % n: n for n in range(1, 7)})
for name, part in parts.items():
    eds = read_eds(path("bus", part["dcf"]), part["node_id"])
    faults = [f for way in ("rpdo", "tpdo") for n, pdo in part[way].items() for f in pdo_faults(way, n, pdo, eds)]
    check(f"{name}: PDOs", not faults, faults)
    faults = [f for o in part["sdo"] for f in sdo_faults(o, eds)]
    check(f"{name}: SDO entries", part["sdo"] and not faults, faults)
    check(f"{name}: all that the driver needs", not needed_faults(part, eds), needed_faults(part, eds))
    check(f"{name}: scales", not scale_faults(part, eds), scale_faults(part, eds))
    numbers = {way: sorted(part[way]) for way in ("rpdo", "tpdo")}
    there = {
        way: sorted(i - base + 1 for i, s in eds if s == 1 and base <= i < base + 512)
        for way, base in (("rpdo", 0x1400), ("tpdo", 0x1800))
    }
    check(f"{name}: every PDO of the drive is on or off here", numbers == there, (numbers, there))
    modes = {key: part[key] for key in ("position_mode", "velocity_mode", "effort_mode")}
    check(f"{name}: modes are supported", all(eds[SUPPORTED].default >> (m - 1) & 1 for m in modes.values()), modes)
    check(
        f"{name}: identity and driver",
        part["revision_number"] == eds[0x1018, 3].default
        and (part["driver"], part["package"]) == ("ros2_canopen::Cia402Driver", "canopen_402_driver")
        and part["polling"] is True
        and part["period"] == 10,
        part,
    )
check(
    "an EDS is that of many drives: it has no serial number, which a master would insist on",
    all(read_eds(path("bus", p["dcf"]), p["node_id"])[0x1018, 4].default is None for p in parts.values()),
)
same = harness.run(hil, "eds", scenario, "--node", "3", "--cycle", "10").stdout
check("the EDS is that of the command eds", content("bus/node3.eds") == same)
used = [pdo["cob_id"] for p in parts.values() for way in ("rpdo", "tpdo") for pdo in p[way].values() if pdo["enabled"]]
check("every identifier is that of one PDO", len(used) == len(set(used)) >= 24, used)
readme = content("bus/README.md")
check(
    "README.md: drives, package, launch, services",
    all(
        text in readme
        for text in (
            f"tribotwin-hil drive {scenario} --can vcan0 --realtime --cycle 10",
            "generate_dcf(bus)",
            "ros2 launch canopen_core canopen.launch.py",
            "/joint1/target",
            "/joint1/position_mode",
            f"{1 + len(used)} frames per cycle",
        )
    ),
    readme,
)

os.mkdir(path("a b"))
made("a b/it's", "--set", "temperature_degC=30", "--first-node", "7")
readme = content("a b/it's/README.md")
words = [line for line in readme.splitlines() if line.startswith(("    tribotwin-hil", "    mkdir"))]
check(
    "README.md: words of the shell, a name for CMake",
    [shlex.split(w) for w in words]
    == [
        "mkdir canopen_it_s/config && cp -r it's canopen_it_s/config/it_s".split(),
        f"tribotwin-hil drive {scenario} --set temperature_degC=30 "
        "--can vcan0 --realtime --cycle 10 --first-node 7".split(),
    ],
    words,
)

# ---- Cycles: SYNC, the driver's loop, 1006h and 60C2h.
for cycle, us, period, time, exponent in (
    ("10", 10000, 10, 10, -3),
    ("4", 4000, 4, 4, -3),
    ("0.5", 500, 1, 5, -4),
    ("1.25", 1250, 1, 125, -5),
    ("300", 300000, 300, 30, -2),
    ("1000", 1000000, 1000, 100, -2),
):
    bus, parts = made("cycle" + cycle, "--cycle", cycle)
    one = parts["joint1"]
    found = {(o["index"], o["sub_index"]): o["value"] for o in one["sdo"]}
    got = bus["master"]["sync_period"], one["period"], found[0x1006, 0], found[0x60C2, 1], found[0x60C2, 2]
    check(f"--cycle {cycle}", got == (us, period, us, time, exponent), got)
r = ros2("-o", "fast", "--cycle", "1")
check("more than a bus of 1 Mbit/s carries is said", r.returncode == 0 and "% of the bus" in r.stderr, r.stderr)

# ---- Node numbers and names.
bus, parts = made("late", "--first-node", "122")
check("the last number is a drive's: the master has the lowest", bus["master"]["node_id"] == 1, bus["master"])
check("node122.eds", parts["joint1"]["dcf"] == "node122.eds" and os.path.exists(path("late", "node122.eds")))
for joint, name in (
    ("hinge", "hinge"),
    ("left hinge", "left_hinge"),
    ("2nd", "_2nd"),
    ("on", "on"),  # without quotes a truth value
    ("webmaster", "node1"),
    ("no options", "node1"),
):
    with open(path("one.xml"), "w") as f:
        f.write(PENDULUM.replace('"hinge"', f'"{joint}"'))
    with open(path("one.yaml"), "w") as f:
        f.write("model: one.xml\nduration_s: 1\ncontrol: {type: torque}\n")
    bus, parts = made("named", "--force", robot="one.yaml")
    check(f"joint '{joint}' is {name}", list(parts) == [name], list(parts))

# ---- Folders.
before = {f: content("bus/" + f) for f in os.listdir(path("bus"))}
check_refused("a folder with files", ros2("-o", "bus", "--cycle", "5"), "holds files already")
check("stays as it was", before == {f: content("bus/" + f) for f in os.listdir(path("bus"))})
with open(path("bus", "notes.txt"), "w") as f:
    f.write("mine")
made("bus", "--cycle", "5", "--force")
check(
    "--force replaces its own files and no others",
    "sync_period: 5000" in content("bus/bus.yml") and content("bus/notes.txt") == "mine",
)
before = content("bus/bus.yml")
os.remove(path("bus", "node6.eds"))
os.mkdir(path("bus", "node6.eds"))
check_refused("a folder where a file shall be", ros2("-o", "bus", "--force"), ("node6.eds", "is a folder"))
check("leaves the other files", content("bus/bus.yml") == before)
os.mkdir(path("empty"))
made("empty/")
check("an empty folder", "bus.yml" in os.listdir(path("empty")))
disk = "mount -t tmpfs disk disk && " + shlex.join([hil, "ros2", scenario, "-o", "disk"])
os.mkdir(path("disk"))
if harness.run("unshare", "-m", "mount", "-t", "tmpfs", "disk", "disk").returncode == 0:
    r = harness.run("unshare", "-m", "sh", "-c", disk + " && ls disk/bus.yml")
    check("an empty folder that is a disk of its own", r.returncode == 0, r.stderr)
with open(path("file"), "w") as f:
    f.write("mine")
for name, arguments, says in (
    ("a file", ("-o", "file", "--force"), "is no folder"),
    ("no such place", ("-o", "nowhere/bus"), "there is no folder"),
    ("nodes beyond 127", ("-o", "new", "--first-node", "125"), "at most 127"),
):
    check_refused(name, ros2(*arguments), says)
check_refused("no folder named", ros2(), "--output", lines=None)
check_refused("no name", ros2("-o", ""), "empty", lines=None)
check_refused("a cycle of nothing", ros2("-o", "new", "--cycle", "0"), "--cycle", lines=None)
check_refused("no scenario", ros2("-o", "new", robot="nowhere.yaml"), "nowhere.yaml")
check("and nothing was written", not os.path.exists(path("new")) and content("file") == "mine")
os.mkdir(path("own"))
shutil.copy(path("one.xml"), path("own", "one.xml"))
shutil.copy(path("one.yaml"), path("own", "bus.yml"))
check_refused("the scenario itself", ros2("-o", "own", "--force", robot="own/bus.yml"), "bus.yml")
left = [f for f in os.listdir(path()) if ".partial-" in f]
check("no litter", not left, left)
finish()
