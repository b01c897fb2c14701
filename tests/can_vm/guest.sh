#!/usr/bin/env bash
# The rest of the VM's start: buses, then the command with its output on the terminals that are our caller's pipes.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root TERM=dumb
kernel=$(uname -r)
mkdir -p /lib/modules
[ -e "/lib/modules/$kernel" ] || ln -s "/usr/lib/uml/modules/$kernel" /lib/modules/
if bash "$JOB/buses.sh"; then
  exec 3>/dev/tty1 4>/dev/tty2   # held open, or the first close would hang up
  stty -F /dev/tty1 raw -echo
  stty -F /dev/tty2 raw -echo
  touch "$JOB/booted"
  setsid bash "$JOB/command" </dev/null >&3 2>&4 3>&- 4>&-
  code=$?
  stty -F /dev/tty1 sane; stty -F /dev/tty2 sane   # waits until all output is out
  echo $code >"$JOB/exit_code.new" && mv "$JOB/exit_code.new" "$JOB/exit_code"
  sync
fi
busybox poweroff -f
