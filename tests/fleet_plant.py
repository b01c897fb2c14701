"""A synthetic plant as tables of friction curves: robots, days, temperature and measurement scatter as on the BR609's
third joint."""
import datetime, sys

import numpy as np

speeds = np.array([0.17, 0.87, 1.75, 2.62, 3.49, 5.24, 8.73, 13.96, 17.45, 26.18, 52.36, 78.54, 104.7, 139.6, 174.5])
load = np.array([0.39, 0.39, 0.39, 0.39, 0.39, 0.39, 0.39, 0.38, 0.38, 0.36, 0.35, 0.30, 0.32, 0.34, 0.36])
HEADER = "robot,joint,date,speed_rad_s,load_norm,temperature_degC,friction_nm,stderr_nm"
first_day = datetime.date(2026, 3, 1)


class Joint:
    """persistence, day: of the deviation from day to day, relative."""

    def __init__(self, random, persistence=0.8, day=0.015):
        self.random, self.persistence, self.day = random, persistence, day
        self.own = np.exp(random.normal(0, (0.08, 0.07, 0.1, 0.1)))
        self.deviation = random.normal(0, day, 4)
        self.noise_nm = 0.05 * np.sqrt(20 / random.chisquare(20))

    def curve(self, wear=0.0):
        """Temperature and friction of the next day."""
        phi, random = self.persistence, self.random
        self.deviation = phi * self.deviation + np.sqrt(1 - phi**2) * random.normal(0, self.day, 4)
        boundary, standstill, stribeck, viscous = self.own * np.exp(self.deviation)
        T = random.uniform(25, 58)
        Fc = (1 + wear) * boundary * (4.752 + 0.0162 * T + 3.24 * load)
        Fs = (1 + wear) * standstill * (7.8 + 4.68 * load) * np.maximum(1, 1.02 * Fc / (7.8 + 4.68 * load) / standstill)
        Vs = (1 + wear) * stribeck * (2 + 0.025 * T)
        friction = Fc + (Fs - Fc) * np.exp(-((speeds / Vs) ** 1.3))
        friction += viscous * 3.39855 * np.exp(-T / 32) * speeds ** (0.5 + 0.0025 * T)
        return T, friction + random.normal(0, self.noise_nm, speeds.size)


class Plant:
    def __init__(self, robots, joints=("joint2", "joint3"), seed=1, **options):
        self.random = np.random.default_rng(seed)
        self.joints = {(f"R{r:04}", j): Joint(self.random, **options) for r in range(robots) for j in joints}
        self.day = 0

    def rows(self, days, worn={}):
        """The rows of a table of further days; `worn`: (robot, joint) to relative wear."""
        rows = []
        for day in range(self.day, self.day + days):
            date = (first_day + datetime.timedelta(day)).isoformat()
            for (robot, joint), j in self.joints.items():
                T, friction = j.curve(worn.get((robot, joint), 0.0))
                for v, l, f in zip(speeds, load, friction):
                    rows.append(f"{robot},{joint},{date},{v:g},{l:g},{T:.3f},{f:.5f},0.05")
        self.day += days
        return rows

    def write(self, name, days, worn={}):
        rows = self.rows(days, worn)
        with open(name, "w") as f:
            f.write("\n".join([HEADER, *rows]) + "\n")
        return rows


if (
    __name__ == "__main__"
):  # ROBOTS DAYS FILE DAYS FILE: healthy days, then days on which joint2 of R0003 is worn by 20 %
    robots, days, healthy, more_days, week = sys.argv[1:6]
    some = Plant(int(robots))
    some.write(healthy, int(days))
    some.write(week, int(more_days), {("R0003", "joint2"): 0.2})
