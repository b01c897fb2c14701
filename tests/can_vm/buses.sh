#!/usr/bin/env bash
# Brings vcan0 and vcan1 up, CAN FD included, in the network namespace or VM it runs in; fails where the kernel has no
# CAN.
set -euo pipefail
ip link set dev lo up
for bus in vcan0 vcan1; do
  ip link add dev $bus type vcan
  ip link set dev $bus mtu 72 up
done
cansend vcan0 000#
