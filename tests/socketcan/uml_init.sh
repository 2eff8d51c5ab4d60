#!/bin/sh
# First process of the User-Mode Linux that with_vcan.py boots; $job_dir comes from the kernel's command line.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
stty -onlcr
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mountpoint -q /dev || mount -t devtmpfs devtmpfs /dev
mkdir -p /dev/pts /dev/shm
mount -t devpts devpts /dev/pts
mount -t tmpfs tmpfs /dev/shm
mount -t tmpfs tmpfs /run
ln -s /proc/self/fd /dev/fd
ln -s fd/0 /dev/stdin
ln -s fd/1 /dev/stdout
ln -s fd/2 /dev/stderr

for module in net/can/can net/can/can-raw net/can/can-bcm net/can/can-gw drivers/net/can/dev/can-dev drivers/net/can/vcan; do
    insmod "/usr/lib/uml/modules/$(uname -r)/kernel/$module.ko"
done
ip link set lo up
ip link add dev vcan0 type vcan && ip link set vcan0 up

# The exit code travels in a file: that of a User-Mode Linux does not carry it.
/bin/sh "$job_dir/job.sh"
echo $? >"$job_dir/exit_code"
sync
exec /bin/busybox poweroff -f
