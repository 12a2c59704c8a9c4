#!/bin/busybox sh
# The first process: mounts the files of the host, read-only, and continues there.
/bin/busybox --install -s /bin
mount -t devtmpfs dev /dev
for module in $(cat /modules/order); do insmod /modules/$module; done
mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=loose,ro root /root
mount -t proc proc /root/proc
mount -t sysfs sys /root/sys
mount -t tmpfs run /root/run
mount -t tmpfs tmp /root/tmp
mount --move /dev /root/dev
mkdir -p /root/dev/shm /root/dev/pts /root/run/share
mount -t tmpfs shm /root/dev/shm
mount -t devpts pts /root/dev/pts
mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000 share /root/run/share
exec switch_root /root /bin/sh /run/share/start.sh
