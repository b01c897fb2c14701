"""Every number outside the figures of a study's page, against diagnosis.json alone."""
import re

from numbers_of_page import Numbers, typeset, version

DISTANCES = (4, 36)  # of Zhou 2024: anomalous, wear


def on_faults(joint):
    return [o for o in joint["observations"] if o.get("faults") or o["state"] == "wear"]


def on_loads(joint):
    return [o for o in joint["observations"] if o not in on_faults(joint)]


def hits(some, key):
    return f"{sum(map(key, some))} of {len(some)}"


def take_head(n, joints):
    loads = [o for joint in joints.values() for o in on_loads(joint)]
    faults = [o for joint in joints.values() for o in on_faults(joint)]
    anomalous = lambda o: o["anomalous"]
    noticed = hits([o for o in loads if o["load_kg"]], anomalous)
    alarms = hits([o for o in loads if not o["load_kg"]], anomalous)
    named = hits(faults, lambda o: o["pattern"] in o.get("faults", [o["state"]]))
    n.take(
        "verdict",
        f"{noticed} curves with a payload are noticed, {alarms} new healthy ones without a payload are false alarms, "
        f"{named} curves with a fault are named by it.",
    )
    n.take("joints", f"\njoints\n{len(joints)}\n")
    n.take("learned", f"\nlearned\n{sum(len(joint['learned']) for joint in joints.values())}\n")
    n.take("loads", f"\nloads noticed\n{noticed}\n")
    n.take("alarms", f"\nfalse alarms\n{alarms}\n")
    n.take("faults", f"\nfaults named\n{named}\n")


def take_flagged(n, name, joint):
    """What each region flags, in words."""
    said = f"{name}:"
    for k, of in enumerate(("contact surfaces", "lubricant"), 1):
        which = [f"{o['load_kg']:g} kg, {o['state']}" for o in on_loads(joint) if o[f"region{k}"]["anomalous"]]
        said += f" Region {k} ({of}) flags {'; '.join(which) or 'nothing'}."
    n.take(f"{name}: what is flagged", said)


def distances(joint):
    yes = lambda region: "yes" if region["anomalous"] else "no"
    for i, o in enumerate(on_loads(joint), 1):
        row = [str(i), f"{o['load_kg']:g} kg", o["state"], f"{o['temperature_degC']:.1f}"]
        for region in (o["region1"], o["region2"]):
            row += [f"{region['distance']:.3f}", f"{region['statistic']:.2f}", yes(region)]
        yield row + [o["pattern"]]


def severity(power, factor):
    text = typeset(f"{factor * power['detection_limit']:.2g}")
    return text + ("" if power["unit"] == "1" else " " + power["unit"])


def shares(joint, columns):
    """Of the curves that are drawn, a row for each fault."""
    for power in joint["power"]:
        named = power["named_at_twice_the_limit"]
        row = [f"{power['fault'].replace('_', ' ')}, {severity(power, 2)}"]
        yield row + [f"{100 * named[c]:.3g} %" if c in named else "–" for c in columns]


def counts(joint, columns):
    """Of the simulated curves with a fault, a row for each run of the same fault."""
    seen = {}
    for o in on_faults(joint):
        patterns = seen.setdefault(", ".join(o.get("faults", [o["state"]])), [])
        patterns.append(o["pattern"])
    for fault, patterns in seen.items():
        yield [fault] + [str(patterns.count(c)) if c in patterns else "–" for c in columns]


def hold_joint(page, check, name, joint, footprints):
    n, columns = Numbers(page, check), list(footprints)
    with_unknown = lambda named: columns + ["unknown"] * ("unknown" in named)
    patterns = [o["pattern"] for o in on_faults(joint)]
    drawn = [pattern for power in joint["power"] for pattern in power["named_at_twice_the_limit"]]
    rows = [*distances(joint), *counts(joint, with_unknown(patterns)), *shares(joint, with_unknown(drawn))]
    for row in rows:
        n.take(f"row {row[0]}", "\n".join(row) + "\n")
    for power in joint["power"]:
        limit = f"{footprints[power['fault']]}; detection limit {severity(power, 1)}."
        n.take(f"limit of {power['fault']}", limit)
    limits = [on_loads(joint)[0][region]["limit"] for region in ("region1", "region2")]
    n.take(
        "limits",
        f"distances beyond {DISTANCES[0]} anomalous.",
        "beyond {:.2f} in region 1, {:.2f} in region 2.".format(*limits),
        "The ellipsoid of region 1 seen along each of its axes, and the ellipse of region 2: filled within {:g} "
        "standard deviations, dashed at {:g}.".format(*(d**0.5 for d in DISTANCES)),
    )
    # What is no measured number: columns, the paper, the share that defines a detection limit.
    columns = [f"{word} {k}\n" for k in (1, 2) for word in ("distance region", "T²", "anomalous")]
    figures = ("Figures 9 and 10", "Figure 11", "Figure 12", "Figure 13", "Tables II and III")
    n.take(
        "words", *columns, *(f"as {f} of Zhou 2024" for f in figures[:4]), f"As {figures[4]} of Zhou 2024", "eq. (15)"
    )
    n.take("definition", "(Zhou 2024)", "detected in 95 % of the curves")
    n.finish(f"study, {name}")


def hold(page, check, joints, footprints, day, engine):
    """`joints`: diagnosis.json, which was written on `day`, of curves that this version of the engine simulated.
    `footprints`: of each fault, as `tribotwin list faults` has them. Each joint's part is held by itself, so that no
    number of one stands for that of another."""
    head, *parts = re.split("<h2[^>]*>", page[page.index("<main>") : page.index("</main>")])
    n = Numbers(head + "</main>", check)
    take_head(n, joints)
    for name, joint in joints.items():
        take_flagged(n, name, joint)
    n.take("identity", f"written {day} · page made with tribotwin {version()} · simulated by MuJoCo {engine}\n")
    n.take("words", "fewer than 80 % of the faults", "of Zhou 2024")
    n.finish("study")
    Numbers(f"<main>{parts[-1]}</main>", check).finish("study, origin")
    check("study: a part for each joint", len(parts) == len(joints) + 1, len(parts))
    for part, (name, joint) in zip(parts, joints.items()):
        hold_joint(f"<main>{part}</main>", check, name, joint, footprints)
