#!/bin/bash
# Creates the simulated hardware before its users start: a GPIO chip, a video device that a program writes into, and the kernel's own virtual cameras.
set -e
modprobe -a configfs irq_sim gpio-sim
mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config
chip=/sys/kernel/config/gpio-sim/rig
mkdir -p $chip/bank0
echo 16 >$chip/bank0/num_lines
echo rig-gpio >$chip/bank0/label
k=0
for name in COLLIMATOR_A COLLIMATOR_B BARRIER ENCODER SPARE; do
    mkdir $chip/bank0/line$k
    echo $name >$chip/bank0/line$k/name
    k=$((k + 1))
done
echo 1 >$chip/live
modprobe v4l2loopback
modprobe vivid
modprobe vimc
ip link set lo up
