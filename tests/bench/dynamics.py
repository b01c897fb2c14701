"""Six axes, 10^6 samples: tribotwin dynamics against numpy.linalg.lstsq on the same regressor and torques, paired in
one run. Argument: the benchmark program dynamics_fit (build/release/tests). numpy needs the whole regressor, 2.8 GB
at 10^6 samples and more inside: the ratio is taken at a tenth of them."""
import json, subprocess, sys, tempfile, time

import numpy as np

program = sys.argv[1]
for samples in (100_000, 1_000_000):
    with tempfile.NamedTemporaryFile() as f:
        ours = json.loads(
            subprocess.run(
                [program, str(samples), f.name if samples <= 100_000 else ""],
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )
        text = f"{samples} samples: dynamics {ours['seconds']:.1f} s, {ours['peak_GiB']:.2f} GiB"
        if samples <= 100_000:
            A = np.fromfile(f.name).reshape(-1, ours["columns"] + 1)
            begin = time.perf_counter()
            x, *_ = np.linalg.lstsq(A[:, :-1], A[:, -1], rcond=None)
            numpy_s = time.perf_counter() - begin
            text += (
                f"; numpy.linalg.lstsq {numpy_s:.1f} s without making the regressor: "
                f"{numpy_s / ours['seconds']:.1f} x; "
                f"largest difference of parameters {np.abs(x - ours['parameters']).max():.1e}"
            )
        print(text)
