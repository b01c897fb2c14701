#!/usr/bin/env bash
# Installs the Debian packages that building and running needs; with --tests also those of the tests.
set -euo pipefail
packages=(
  g++ cmake ninja-build
  libmujoco-dev libqhull-dev libgl-dev libopengl-dev   # the engine, and what its CMake files insist on
  libeigen3-dev libpugixml-dev libyaml-cpp-dev libcli11-dev libfmt-dev
  nlohmann-json3-dev libhdf5-dev libexpected-dev
  libzip-dev libmatio-dev                              # tables in .npz and .mat, FMUs
  liblz4-dev libzstd-dev                               # chunks of .mcap
  libsqlite3-dev libpqxx-dev                           # the store of a fleet: a file, or PostgreSQL
  libceres-dev libboost-dev                            # identification: trust region, distributions; the live bench
  libjs-three                                          # the robot on the page of the live bench
  pybind11-dev python3-dev python3-numpy               # the Python module
  libosmesa6-dev liblodepng-dev libpango1.0-dev pkg-config   # pictures
  gnuplot-nox fonts-dejavu-core                              # run by tribotwin-report
)
if [ "${1:-}" = --tests ]; then
  packages+=(
    libgtest-dev libgmock-dev libbenchmark-dev libmujoco-samples
    clang-format clang-tidy black doxygen   # format, static analysis, API reference
    python3 python3-h5py python3-scipy python3-yaml chromium ffmpeg
    user-mode-linux gcc libc6-dev kmod iproute2 can-utils busybox-static util-linux   # the CAN VM
    python3-can python3-canmatrix tshark mandoc
    dpkg-dev lintian   # Debian packages
    clang                     # compiles the exported C
    lld wasi-libc libc++-14-dev-wasm32   # compiles what pages compute in browsers
    python3-pip python3-setuptools python3-wheel   # a wheel of the Python module
    libopenmpi-dev openmpi-bin   # programs on several ranks
    slurmctld slurmd slurm-client   # a job of a cluster
  postgresql-15   # a fleet's store in a database
  )
fi
missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null ||
    { echo "These packages are missing and need root to install: ${missing[*]}" >&2; exit 1; }
  as_root=(sudo)
fi
echo "Installing: ${missing[*]}"
"${as_root[@]}" apt-get update -q
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "${missing[@]}"
