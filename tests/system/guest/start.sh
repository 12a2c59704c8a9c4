#!/bin/sh
# The first process of the guest after its root is mounted: executes each line that comes on the
# second serial port as a command, and writes the exit code there.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp
export PYTHONDONTWRITEBYTECODE=1
stty -F /dev/ttyS1 115200 raw -echo clocal
exec 3<>/dev/ttyS1
ip link set lo up
/lib/systemd/systemd-udevd --daemon
echo "done 0" >&3
while read -r command <&3; do
    sh -c "$command" </dev/null >/run/share/output 2>&1 3>&-
    echo "done $?" >&3
done
