#!/bin/bash
# Builds the parts of the rig's machine from Debian 12 packages alone: machine.sh CACHE DEPENDENCY...
# Leaves in CACHE: vmlinuz, initrd.img (finds its disks), base.squashfs (the root: systemd, tools, the DEPENDENCYs) and modules/ (stock
# modules and four that Debian's kernel does not build). Parts that are up to date are kept. Needs root, for mmdebstrap.
set -euo pipefail
cache=$1
shift
suite=bookworm
mkdir -p "$cache"
cd "$cache"

# The root and its packages come from a named mirror, independent of the host's own sources.
packages=systemd,systemd-sysv,udev,dbus,kmod,procps,iproute2,util-linux,e2fsprogs,dmsetup,gpiod,v4l-utils,libcamera-ipa,init-system-helpers
for dependency in "$@"; do packages+=,$dependency; done

kernel=$(apt-cache depends linux-image-amd64 | sed -n 's/^ *Depends: linux-image-//p' | head -n 1)
[ -n "$kernel" ] || { echo "machine.sh: apt knows no linux-image-amd64: run apt-get update" >&2; exit 2; }
step() { printf '   %s (%s s)\n' "$1" "$SECONDS"; }

# The key of a part lists all its inputs; a part whose key differs is rebuilt.
fits() { [ -e "$1" ] && [ "$(cat "$1.key" 2>/dev/null)" = "$2" ]; }
keep() { printf '%s\n' "$2" >"$1.key"; }

kernel_key="$kernel, made as 6"  # increment when the build steps change
base_key="$suite $packages $(date +%Y-%m), made as 1"

headers=$cache/k/usr/src/linux-headers-$kernel
unpack_kernel() {
    rm -rf k src dl && mkdir -p k src dl
    (cd dl && apt-get -qq -o APT::Sandbox::User=root download "linux-image-$kernel" "linux-headers-$kernel" "linux-headers-${kernel%-amd64}-common" \
        linux-kbuild-6.1 linux-source-6.1 v4l2loopback-dkms busybox-static)
    step "kernel packages are here"
    local deb
    for deb in dl/linux-image-* dl/linux-headers-* dl/linux-kbuild-* dl/v4l2loopback-dkms* dl/busybox-static*; do dpkg-deb -x "$deb" k; done
    sed -i "s#/usr/src/#$cache/k/usr/src/#" "$headers/Makefile"  # the only absolute path in the headers
    dpkg-deb --fsys-tarfile dl/linux-source-6.1_* | tar -xO ./usr/src/linux-source-6.1.tar.xz | xz -dcT0 |
        tar -x -C src --strip-components=1 linux-source-6.1/drivers/gpio/gpio-sim.c linux-source-6.1/drivers/gpio/gpiolib.h linux-source-6.1/kernel/irq/irq_sim.c linux-source-6.1/drivers/media/test-drivers/vimc
    rm -rf dl
    depmod -b k "$kernel"
}

# gpio-sim with the interrupts it simulates, v4l2loopback and vimc. irq_sim is no module in Debian's kernel: it becomes one here
# (a licence tag; irq_to_desc() is not exported on x86).
build_modules() {
    rm -rf mod && mkdir mod
    cp src/drivers/gpio/gpio-sim.c src/drivers/gpio/gpiolib.h src/kernel/irq/irq_sim.c src/drivers/media/test-drivers/vimc/*.[ch] k/usr/src/v4l2loopback-*/*.[ch] mod
    sed -i 's|^#include <linux/slab.h>|&\n#include <linux/module.h>|; s|irq_to_desc(irqnum)|irq_data_to_desc(irq_get_irq_data(irqnum))|' mod/irq_sim.c
    echo 'MODULE_LICENSE("GPL");' >>mod/irq_sim.c
    printf '%s\n' 'obj-m := irq_sim.o gpio-sim.o v4l2loopback.o vimc.o' \
        'vimc-y := vimc-core.o vimc-common.o vimc-streamer.o vimc-capture.o vimc-debayer.o vimc-scaler.o vimc-sensor.o vimc-lens.o' >mod/Kbuild
    make -s -C "$headers" M="$cache/mod" -j"$(nproc)" CC=gcc-12 modules >mod/log 2>&1 || { cat mod/log >&2; exit 1; }
    strip --strip-debug mod/*.ko
    step "modules are built"
}

closure() { for m in "$@"; do modprobe -d "$cache/k" -S "$kernel" --show-depends "$m" 2>/dev/null | awk '$1 == "insmod" {print $2}'; done | awk '!seen[$0]++'; }

collect_modules() {
    local f to=modules/usr/lib/modules/$kernel
    rm -rf modules && mkdir -p "$to/extra"
    for f in $(closure virtio_pci virtio_blk virtio_console squashfs overlay ext4 configfs videodev vivid v4l2-tpg videobuf2-vmalloc videobuf2-dma-contig autofs4 loop dm-mod); do
        install -D -m644 "$f" "$to/${f#"$cache/k/lib/modules/$kernel/"}"
    done
    cp mod/*.ko "$to/extra/"
    cp "k/lib/modules/$kernel"/modules.{order,builtin,builtin.modinfo} "$to/"
    ln -s usr/lib modules/lib
    depmod -b modules "$kernel"
    rm modules/lib  # the guest has its own, to usr/lib
}

# Finds three disks: the root, what the run brings, and one that can be written to and stays over a power cut. With rig.memory on the kernel's
# command line what is written stays in memory: virtual time passes at once while the machine has nothing to do, and a disk, which the
# host serves in its own time, would seem to take seconds for a page.
make_initrd() {
    local f i=initrd
    rm -rf $i && mkdir -p $i/{bin,dev,proc,sys,m,base,pay,rw,root}
    cp k/bin/busybox $i/bin/
    for f in $(closure virtio_pci virtio_blk squashfs overlay ext4); do
        cp "$f" $i/m/
        basename "$f" >>$i/order
    done
    cat >$i/init <<'TXT'
#!/bin/busybox sh
b=/bin/busybox
$b mount -t devtmpfs none /dev; $b mount -t proc none /proc; $b mount -t sysfs none /sys
out() { echo "initrd: $*"; $b reboot -f; }  # the machine ends with it
while read m; do $b insmod /m/$m || echo "initrd: insmod $m failed"; done < /order
if $b grep -q rig.memory /proc/cmdline; then last=/dev/vdb rw='-t tmpfs none'; else last=/dev/vdc rw='-t ext4 /dev/vdc'; fi
n=0; while [ ! -b $last ] && [ $n -lt 600 ]; do $b sleep 0.05; n=$((n+1)); done
$b mount -t squashfs -o ro /dev/vda /base && $b mount -t squashfs -o ro /dev/vdb /pay && $b mount $rw /rw || out "the root's parts cannot be mounted"
$b mkdir -p /rw/u /rw/w
$b mount -t overlay -o lowerdir=/pay:/base,upperdir=/rw/u,workdir=/rw/w none /root || out "the root cannot be mounted"
$b mount --move /dev /root/dev; $b umount /proc; $b umount /sys
exec $b switch_root /root /sbin/init
TXT
    chmod +x $i/init
    (cd $i && find . | cpio -o -H newc --quiet | zstd -q -3 -f -o ../initrd.img)
    rm -rf $i
}

if ! fits vmlinuz "$kernel_key"; then
    unpack_kernel
    build_modules
    collect_modules
    make_initrd
    cp "k/boot/vmlinuz-$kernel" vmlinuz
    keep vmlinuz "$kernel_key"
    rm -rf k src mod
    step "kernel and modules"
fi

if ! fits base.squashfs "$base_key"; then
    rm -rf base base.squashfs
    mmdebstrap --quiet --variant=minbase --include="$packages" --aptopt='Acquire::Languages "none"' \
        --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
        --customize-hook='rm -rf "$1"/usr/lib/x86_64-linux-gnu/gconv "$1"/var/cache/apt/*.bin "$1"/var/lib/apt/lists/*; : >"$1"/etc/machine-id; echo rig >"$1"/etc/hostname; touch "$1"/etc/.updated "$1"/var/.updated' \
        "$suite" base
    step "root is installed"
    mksquashfs base base.squashfs -no-xattrs -comp zstd -Xcompression-level 3 -noappend -quiet -no-progress
    rm -rf base
    keep base.squashfs "$base_key"
    step "root"
fi
