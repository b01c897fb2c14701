"""What Python costs beyond C++, in one run: a step of a twin with a torque per step, and a law over arrays.

    PYTHONPATH=build/release/python /usr/bin/python3 tests/bench/python.py build/release [STEPS]

Both sides alternate; medians of the pairwise differences and ratios count."""
import statistics, subprocess, sys, time

import numpy as np

import tribotwin

build = sys.argv[1]
steps = int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000
block = 250


def seconds(work):
    """Of this process, so that others on the machine count less."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def step_overhead_us():
    """Blocks of steps with a torque from Python in each, beside blocks that C++ steps at the same torque."""
    twin = tribotwin.Twin("irb6620_hold", commanded=True)
    torque = np.zeros(len(twin.joints))

    def by_python():
        for k in range(block):
            torque[0] = 1e-3 * k
            twin.step(torque_nm=torque)

    extra, cpp = [], []
    for _ in range(steps // (2 * block)):
        mine = seconds(by_python)
        cpp.append(seconds(lambda: twin.step(block, torque_nm=torque)))
        extra.append((mine - cpp[-1]) / block)
    return [1e6 * x for x in statistics.quantiles(extra, n=4)], 1e6 * statistics.median(cpp) / block


def law_ratios(n, pairs=25):
    law = tribotwin.Law("extended")
    random = np.random.default_rng(1)
    speed, load, temperature = random.uniform(0, 280, n), random.uniform(0, 0.6, n), random.uniform(40, 80, n)
    program = f"{build}/tests/twin_python_reference"
    ratios = []
    for _ in range(pairs):
        out = subprocess.run([program, "time", str(n), "9"], capture_output=True, text=True, check=True).stdout
        cpp = statistics.median(map(float, out.split()))
        mine = statistics.median(seconds(lambda: law(speed, load, temperature)) for _ in range(9))
        ratios.append(mine / cpp)
    return statistics.quantiles(ratios, n=4)


quartiles, cpp = step_overhead_us()
print(f"step of a robot with a torque: {quartiles[1]:.2f} us beyond C++ (quartiles {quartiles[0]:.2f} and", end=" ")
print(f"{quartiles[2]:.2f}); C++ alone {cpp:.1f} us; bar 2 us")
for n in (1_000, 100_000, 1_000_000):
    low, middle, high = law_ratios(n)
    print(f"law over {n} states: {middle:.3f} x C++ (quartiles {low:.3f} and {high:.3f}); bar 1.1")
