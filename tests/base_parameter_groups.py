"""Which inertial parameters of a chain of hinges move it alike: by the energies that each adds to it. Frames of links
are those of a MuJoCo model without turned bodies; parameters and their names those of twin/robot/regressor.hpp."""
import re
import xml.etree.ElementTree as xml

import numpy as np

PARAMETERS = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "mx", "my", "mz", "m")


def chain(model):
    """Name, place in the one before, and axis of each link that has a joint."""
    links = [body for body in xml.parse(model).getroot().iter("body") if body.find("joint") is not None]
    vector = lambda text: np.array([float(x) for x in text.split()])
    return [(body.get("name"), vector(body.get("pos")), vector(body.find("joint").get("axis"))) for body in links]


def turned(axis, angle):
    k = np.cross(np.eye(3), axis).T
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def energies(links, position, velocity):
    """What one unit of each parameter adds to the kinetic less the potential energy."""
    R, p, v, w, added = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), {}
    for i, (name, offset, axis) in enumerate(links):
        p, v = p + R @ offset, v + np.cross(w, R @ offset)
        R, w = R @ turned(axis, position[i]), w + velocity[i] * (R @ axis)
        W, V, up = R.T @ w, R.T @ v, R.T @ [0, 0, 9.81]
        squares = np.outer(W, W)
        inertia = [squares[a, b] * (0.5 if a == b else 1) for a in range(3) for b in range(a, 3)]
        moments = np.cross(V, W) - up
        added |= {f"{name}.{k}": x for k, x in zip(PARAMETERS, [*inertia, *moments, V @ V / 2 - 9.81 * p[2]])}
        added[f"joint{i + 1}.Ia"] = velocity[i] ** 2 / 2
    return added


def coefficients(group):
    """Of "link2.Iyz - 0.27 link3.my"."""
    terms = re.findall(r"(?:(?:^|([+-]) )([\d.]+ )?)((?:link|joint)\d+\.\w+)", group)
    return {name: (-1 if sign == "-" else 1) * float(factor or 1) for sign, factor, name in terms}


def reach(x):
    """How far four digits are from what they show."""
    return 0.51 * 10 ** (np.floor(np.log10(abs(x))) - 3) if abs(x) > 1e-9 else 1e-9


def wrong(model, groups):
    """Coefficients that are not those with which the model moves, each a text; `groups` by their leading parameters.
    A parameter of no group must not move the model. To four digits."""
    links, random = chain(model), np.random.default_rng(1)
    states = [energies(links, *random.uniform(-2, 2, (2, len(links)))) for _ in range(300)]
    columns = {name: np.array([state[name] for state in states]) for name in states[0]}
    columns = {name: x - np.mean(x) for name, x in columns.items()}  # a constant moves nothing
    leading = [g.split()[0] for g in groups]
    said = {name: coefficients(g) for name, g in zip(leading, groups)}
    others = [name for name in columns if name not in leading]
    base, rest = (np.column_stack([columns[name] for name in names]) for names in (leading, others))
    true, *_, singular = np.linalg.lstsq(base, rest, rcond=None)
    bad = [] if singular[-1] > 1e-6 * singular[0] else ["leading parameters that move the model alike"]
    bad += [f"{name}: none" for name, left in zip(others, np.abs(rest - base @ true).T) if np.max(left) > 1e-9]
    for j, name in enumerate(others):
        pairs = [(first, said[first].get(name, 0), true[i, j]) for i, first in enumerate(leading)]
        bad += [f"{first}: {name}: {x:g}" for first, shown, x in pairs if abs(shown - x) > reach(x)]
    return bad
