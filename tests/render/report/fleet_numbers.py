"""Every number outside the figures of a fleet's page, against the store, read by sqlite3, and what tribotwin fleet
check and watch say of a listed joint; its friction is computed from the curves of the store."""
import datetime, math, sqlite3

import numpy as np

from numbers_of_page import Numbers

DAY_S, WINDOW_DAYS = 86400, 10
EXCESS = 2.3  # healthy joints on a list over what its rate says, at most, in tests of the twin


class Plant:
    def __init__(self, store):
        db = sqlite3.connect(store)
        rows = lambda query, *values: db.execute(query, values).fetchall()
        self.end = rows("SELECT MAX(time_s) FROM observations")[0][0]
        self.start = self.end - WINDOW_DAYS * DAY_S + 1
        self.robots = rows("SELECT COUNT(*) FROM robots")[0][0]
        self.joints = rows("SELECT COUNT(*) FROM joints")[0][0]
        window = "FROM observations WHERE learned = 0 AND time_s BETWEEN ? AND ?"
        self.curves, self.judged = rows("SELECT COUNT(*), COUNT(DISTINCT joint) " + window, self.start, self.end)[0]
        self.checks = rows("SELECT time_s, kind, judged, rate FROM checks")
        self.listed = rows("SELECT kind, joint FROM verdicts")
        self.curve_of = rows(
            "SELECT robots.name, joints.name, learned, time_s, Fc_nm, temperature_degC, observations.joint FROM "
            "observations JOIN joints ON joints.id = joint JOIN robots ON robots.id = joints.robot"
        )
        self.files = rows(
            "SELECT files.name, COUNT(*), COUNT(DISTINCT joints.robot), SUM(weak != '') FROM observations JOIN files ON "
            "files.id = file JOIN joints ON joints.id = joint WHERE learned = 0 AND time_s BETWEEN ? AND ? GROUP BY file",
            self.start,
            self.end,
        )
        db.close()

    def of_joint(self, name, learned):
        """By robot: logarithm of Fc, and temperature, of a joint's curves."""
        robots = {}
        for robot, joint, was_learned, time_s, Fc, T, _ in self.curve_of:
            if joint == name and was_learned == learned and (learned or time_s >= self.start):
                robots.setdefault(robot, []).append((math.log(Fc), T))
        return {robot: np.array(rows).T for robot, rows in robots.items()}

    def friction(self, robot, joint):
        """Mean change of Fc in the window and standard deviation of one healthy curve in %, and the healthy curves:
        against the robot's healthy mean, with slopes over T and T^2 that all robots share."""
        healthy = self.of_joint(joint, 1)
        terms = lambda T: np.column_stack([T, T**2])
        inner = lambda x: x - np.mean(x, axis=0)
        x = np.vstack([inner(terms(T)) for _, T in healthy.values()])
        y = np.concatenate([inner(Fc) for Fc, _ in healthy.values()])
        slopes, squares = np.linalg.lstsq(x, y, rcond=None)[:2]
        within = squares[0] / (len(y) - len(healthy) - 2)
        Fc, T = healthy[robot]
        mean = np.mean(Fc - terms(T) @ slopes)
        now, now_T = self.of_joint(joint, 0)[robot]
        change = np.mean(now - terms(now_T) @ slopes) - mean
        return 100 * math.expm1(change), 100 * math.sqrt(within * (1 + 1 / len(Fc))), len(Fc)


def day(time_s):
    return datetime.datetime.fromtimestamp(time_s, datetime.timezone.utc).date().isoformat()


def joints_text(count):
    return f"{count} joint" + "s" * (count != 1)
