#!/bin/sh
# The first process of the guest, once its root is there: obeys what comes on its second serial
# port, a line at a time, and tells there how each command has ended.
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
