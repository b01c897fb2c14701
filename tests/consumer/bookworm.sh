#!/usr/bin/env bash
# bookworm.sh BUILD: installs the Debian packages of a build into a fresh Debian 12, uses them, builds against
# libtribotwin-dev, and purges them. By hand, as root, with debootstrap and the network: 5 min, 2 GB under TMPDIR.
set -euo pipefail
build=$1 here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd) work=$(mktemp -d)
root=$work/root
clean_up() {
  mountpoint -q "$root/proc" && umount "$root/proc"
  rm -rf --one-file-system "$work"
}
trap clean_up EXIT
inside() { chroot "$root" env DEBIAN_FRONTEND=noninteractive LC_ALL=C "$@"; }
files() { (cd "$root" && find usr etc opt srv -not -type d | sort); }

cpack --config "$build/CPackConfig.cmake" -B "$work/packages" > /dev/null
debootstrap --variant=minbase bookworm "$root" ${MIRROR:+"$MIRROR"} > /dev/null
mount -t proc proc "$root/proc"
cp /etc/resolv.conf "$root/etc/"
cp "$work"/packages/*.deb "$root/root/"
cp -r "$here" "$root/root/consumer"
inside apt-get update -q > /dev/null

inside bash -c 'apt-get install -y -q --no-install-recommends /root/tribotwin_*.deb' | tail -1
inside bash -euc 'cd /root; tribotwin run irb6620_warmup --quiet; tribotwin-report runs/irb6620_warmup
  tribotwin-hil budget irb6620_hold; tribotwin --version'
inside bash -c 'apt-get install -y -q --no-install-recommends g++ cmake ninja-build' | tail -1
inside bash -c 'apt-get install -y -q --no-install-recommends /root/libtribotwin-dev_*.deb' | tail -1
inside bash -euc 'cd /root; cmake -G Ninja -S consumer -B build > /dev/null; cmake --build build
  build/consumer /usr/share/tribotwin/twin/scenarios/irb6620_warmup.yaml'
inside apt-get purge -y -q tribotwin libtribotwin-dev | tail -1
left=$(files | grep -i tribotwin || true)
[ -z "$left" ] || { printf 'left after purge:\n%s\n' "$left"; exit 1; }
echo "installed, used, built against, purged: nothing is left"
