#!/bin/busybox sh
# First process of the VM: its root is the host's, read-only. Puts a layer in memory over it and the writable folders
# in.
b=/bin/busybox
$b mount -t proc proc /proc
$b mount -t tmpfs tmpfs /mnt
$b mkdir -p /mnt/upper /mnt/work /mnt/root
root=/mnt/root
$b insmod "/usr/lib/uml/modules/$($b uname -r)/kernel/fs/overlayfs/overlay.ko"
if ! $b mount -t overlay -o lowerdir=/,upperdir=/mnt/upper,workdir=/mnt/work overlay $root; then
  echo "no overlay over the host's files"
  $b poweroff -f
fi
$b mount -t proc proc $root/proc
$b mount -t sysfs sys $root/sys
$b mount -t devtmpfs dev $root/dev
$b mkdir -p $root/dev/pts $root/dev/shm
$b mount -t devpts devpts $root/dev/pts
$b mount -t tmpfs tmpfs $root/dev/shm
$b mount -t tmpfs tmpfs $root/run
while read -r folder; do
  $b mkdir -p "$root$folder"
  $b mount -t hostfs -o "$folder" none "$root$folder" || echo "cannot make $folder writable"
done <"$JOB/writable"
cd $root || exit
$b pivot_root . mnt   # not chroot alone: then the kernel finds no modules, and user namespaces are forbidden
exec $b chroot . /bin/bash "$JOB/guest.sh"
