#!/usr/bin/env bash
# Installs what is needed, builds, runs the IRB 6620 warm-up and writes a report of it. Works as root or with sudo, from
# any folder, twice in a row.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bash "$root/twin/install-packages.sh"
cmake -S "$root" -B "$root/build/release" -G Ninja -DCMAKE_BUILD_TYPE=Release -DTRIBOTWIN_UNITY_BUILD=ON \
  -DTRIBOTWIN_BUILD_TESTS=OFF > /dev/null
cmake --build "$root/build/release" --target tribotwin tribotwin-report tribotwin-hil tribotwin_python
"$root/build/release/bin/tribotwin" run irb6620_warmup -o "$root/runs/quickstart" --force
"$root/build/release/bin/tribotwin-report" "$root/runs/quickstart" --force > /dev/null
echo
echo "Joint 2 of the IRB 6620 worked for 6.08 h and warmed up. The report, one file for any browser:"
echo "  $root/runs/quickstart/report.html"
echo "Its record, which h5py, MATLAB and HDFView open:"
echo "  $root/runs/quickstart/telemetry.h5"
echo "The same as a table:"
echo "  $root/build/release/bin/tribotwin export $root/runs/quickstart --csv"
echo "The same twin in Python:"
echo "  PYTHONPATH=$root/build/release/python /usr/bin/python3 -c 'import tribotwin; help(tribotwin)'"
